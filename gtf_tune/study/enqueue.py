"""Add trials with given options to a study: a colleague's, or those of another study."""

from collections.abc import Mapping

from gtf_tune.definition import StudyDefinition
from gtf_tune.errors import OptionError, numbered
from gtf_tune.pipelines import OptionTable, OptionValue
from gtf_tune.store import enqueued, studies
from gtf_tune.store.database import Database
from gtf_tune.store.studies import stored_definition
from gtf_tune.study.open_study import make_pipeline
from gtf_tune.study.search.space import SearchAxis, SearchSpace, build_space


def enqueue(database: Database, name: str, options: Mapping[str, object]) -> int:
    """Append a trial with these options to a study, raise its budget by one, and return the number of the trial.

    Searched options that are not given have their nominal values. Workers run the trial before they go on with the
    search, whose own trials stay the same. A study that was done is open again.

    Raises
    ------
    OptionError
        The pipeline has no such option or refuses its value, the value lies outside the searched range, or the option
        is not searched and has another value in every trial.
    StorageError
        There is no such study, or it is an unfinished copy.
    """
    study = studies.get(database, name)
    studies.check_whole(study)
    definition = stored_definition(study)
    table = make_pipeline(definition).options
    space = build_space(definition, table)
    checked = table.check(options)
    faults = option_faults(space, definition, table, checked)
    if faults:
        raise OptionError(f"study '{name}' cannot try these options: {numbered(faults)}")
    searched = {axis.name: checked.get(axis.name, axis.nominal) for axis in space.axes}
    table.check({**definition.fixed_options, **searched})
    return enqueued.append(database, study.id, searched)


def option_faults(
    space: SearchSpace, definition: StudyDefinition, table: OptionTable, options: Mapping[str, OptionValue]
) -> list[str]:
    """Return a sentence for every option that a trial of a study cannot have."""
    axes = {axis.name: axis for axis in space.axes}
    faults: list[str] = []
    for name, value in options.items():
        if name in axes:
            faults += _axis_faults(axes[name], value)
            continue
        always = definition.fixed_options.get(name, table.specs[name].default)
        if value != always:
            faults.append(f"option '{name}' is not searched but {always!r} in every trial, not {value!r}; leave it out")
    return faults


def _axis_faults(axis: SearchAxis, value: OptionValue) -> list[str]:
    if axis.takes(value):
        return []
    return [f"option '{axis.name}' is searched over {axis.words}, not {value!r}; widen that, or choose another value"]
