"""Change a stored study: more trials, wider ranges, another sampler; or derive a new study from it.

Changes that would make old and new trials incomparable are refused. A study that differs in such a way can be
*derived*: it is a new study that takes over every run with the same key, so that nothing is computed twice.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gtf_tune.definition import Axis, RangeAxis, StudyDefinition, dump_definition
from gtf_tune.errors import DefinitionError
from gtf_tune.store import studies
from gtf_tune.store.database import Database
from gtf_tune.store.enqueued import numbers_of
from gtf_tune.store.studies import Study, stored_definition
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import defined_budget, make_pipeline
from gtf_tune.study.search.samplers import check_search
from gtf_tune.study.search.space import build_space

# Others may go by the ranges of the first trials, as several of Optuna's samplers do, or cover them evenly.
_WIDENABLE = ("refine", "tpe", "random")


@dataclass(frozen=True)
class Extension:
    """Changes of a study; ``None`` and no axes leave things as they are.

    ``trials`` is the new total, nominal included, and no smaller one unless ``may_shrink``; ``axes`` are new ranges
    (``low``, ``high``, ``log``) by option.
    """

    trials: int | None = None
    noisy_runs: int | None = None
    axes: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    may_shrink: bool = False

    @property
    def is_empty(self) -> bool:
        """Whether nothing is to change."""
        return self.trials is None and self.noisy_runs is None and not self.axes


def extend_study(database: Database, name: str, extension: Extension) -> Study:
    """Change a study in place and return it; a study that was done is open again, a paused or stopped one stays so.

    Raises
    ------
    DefinitionError
        Nothing is to change, or a change would make trials incomparable; the message says why and what to do.
    OptionError
        The pipeline has no such option.
    StorageError
        There is no such study, or it is an unfinished copy.
    """
    study = studies.get(database, name)
    studies.check_whole(study)
    definition = stored_definition(study)
    _refuse(definition, extension)
    _refuse_less(study, definition, extension)
    changed = _changed(definition, extension)
    if extension.trials is not None:  # the total, of which the definition knows those of the search
        changed["search"]["trials"] = max(extension.trials - len(numbers_of(study.resolved)), 1)
    extended = checked_definition(changed, f"study '{name}'")
    studies.replace_definition(database, study.id, dump_definition(extended))
    if studies.state(database, study.id) == "done":  # asked again: until now a worker may have closed it
        studies.set_state(database, study.id, "open")
    return studies.get(database, name)


def change_sampler(database: Database, name: str, sampler: str) -> Study:
    """Let another sampler choose the options of all further trials, and return the study.

    Raises
    ------
    DefinitionError
        There is no such sampler, it cannot be created here, or one of the two is a grid.
    StorageError
        There is no such study, or it is an unfinished copy.
    """
    study = studies.get(database, name)
    studies.check_whole(study)
    definition = stored_definition(study)
    data = definition.model_dump(mode="json")
    data["search"] |= {"sampler": sampler, "sampler_arguments": {}}
    changed = checked_definition(data, f"study '{name}'")
    if changed.search.sampler == definition.search.sampler:
        return study
    if "grid" in (changed.search.sampler, definition.search.sampler):
        raise DefinitionError(
            f"study '{name}' cannot go on from '{definition.search.sampler}' to '{changed.search.sampler}', since the "
            "trials of a grid are its points; create a new study, which takes over every run that is the same"
        )
    check_search(changed, build_space(changed, make_pipeline(changed).options))
    studies.replace_definition(database, study.id, dump_definition(changed))
    return studies.get(database, name)


def derive_study(database: Database, name: str, extension: Extension, new_name: str) -> Study:
    """Create a study that differs from a stored one by an extension of any kind; equal runs are reused."""
    study = studies.get(database, name)
    definition = stored_definition(study)
    data = _changed(definition, extension) | {"name": new_name}
    data["search"]["pruner"] = "none"  # of earlier versions, as is a number of noisy runs that grows
    if extension.noisy_runs is None:
        data["gtf"]["noisy_runs"] = definition.gtf.noisy_runs_max
    return create_study(database, checked_definition(data, f"study '{new_name}'"), Path(study.root))


def _changed(definition: StudyDefinition, extension: Extension) -> dict[str, Any]:
    data: dict[str, Any] = definition.model_dump(mode="json")
    if extension.trials is not None:
        data["search"]["trials"] = extension.trials
    if extension.noisy_runs is not None:
        data["gtf"]["noisy_runs"] = extension.noisy_runs
    data["space"] = {**data["space"], **{name: dict(axis) for name, axis in extension.axes.items()}}
    return data


def _refuse(definition: StudyDefinition, extension: Extension) -> None:
    name = definition.name
    if extension.is_empty:
        raise DefinitionError(
            f"nothing to extend study '{name}' by; give more trials or a wider range, or derive a new study with "
            "another number of noisy runs",
            remedy=("extension",),
        )
    _refuse_unknown(definition, extension)
    derive = "derive a new study by the same changes, which takes over every run that is the same"
    if extension.noisy_runs is not None and extension.noisy_runs != definition.gtf.noisy_runs:
        raise DefinitionError(
            f"the trials of study '{name}' are scored by {definition.gtf.noisy_runs_text} noisy runs each, and scores "
            f"of more runs do not compare with theirs; {derive}",
            remedy=("derive", name),
        )
    for option, axis in extension.axes.items():
        fault = _axis_fault(definition, option, axis)
        if fault:
            raise DefinitionError(
                f"the range of '{option}' cannot change in study '{name}': {fault}; {derive}", remedy=("derive", name)
            )


def _refuse_unknown(definition: StudyDefinition, extension: Extension) -> None:
    """Raise `OptionError`, with the nearest names, for a range of an option that the pipeline does not have."""
    unsearched = {option: axis["low"] for option, axis in extension.axes.items() if option not in definition.space}
    if unsearched:
        table = make_pipeline(definition).options
        table.check({option: low for option, low in unsearched.items() if option not in table.specs})


def _axis_fault(definition: StudyDefinition, option: str, axis: Mapping[str, Any]) -> str:
    """Return why an axis of a study cannot be replaced, or an empty text if it can."""
    old: Axis | None = definition.space.get(option)
    if definition.search.sampler not in _WIDENABLE:
        return f"sampler '{definition.search.sampler}' would lose its place"
    if old is None:
        return "finished trials were not searched along it"
    if not isinstance(old, RangeAxis):
        return "it is a list of values"
    if bool(axis["log"]) != old.log or old.step is not None:
        return "its scale or step would change"
    if axis["low"] > old.low or axis["high"] < old.high:
        return f"trials may lie outside; only ranges around [{old.low:g}, {old.high:g}] are accepted"
    return ""


def _refuse_less(study: Study, definition: StudyDefinition, extension: Extension) -> None:
    now = defined_budget(definition) + len(numbers_of(study.resolved))
    if extension.trials is not None and extension.trials < now and not extension.may_shrink:
        raise DefinitionError(
            f"study '{study.name}' has {now} trials already, more than {extension.trials}, which would be the new "
            "total; give a larger one",
            remedy=("trials",),
        )
