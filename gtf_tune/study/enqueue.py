"""Add trials with given options to a study: a colleague's, or those of another study."""

from collections.abc import Mapping

from gtf_tune.errors import OptionError, numbered
from gtf_tune.store import enqueued, studies
from gtf_tune.store.database import Database
from gtf_tune.store.studies import stored_definition
from gtf_tune.study.open_study import make_pipeline
from gtf_tune.study.search.space import build_space, option_faults


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
