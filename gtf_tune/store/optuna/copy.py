"""Copy an Optuna study from one database to another: trials, attributes, notes."""

import json
import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gtf_tune.pipelines.run import digest
from gtf_tune.store.database import Database
from gtf_tune.store.optuna.tables import optuna_storage, trials_by_id

if TYPE_CHECKING:
    from optuna.trial import FrozenTrial

# optuna-dashboard keeps the notes (and once kept the artifacts) of a trial in the study, under the trial's id.
_KEY_OF_TRIAL = re.compile(r"(dashboard:(?:artifacts:)?)(\d+)(:.*)", re.DOTALL)


def copy_optuna_study(source: Database, target: Database, source_id: int, target_id: int) -> dict[int, int]:
    """Copy trials and attributes of an Optuna study, and return the new id of each trial by its number."""
    old, new = optuna_storage(source), optuna_storage(target)
    trials = trials_by_id(old, source_id)
    copies = {trial.number: new.create_new_trial(target_id, template_trial=trial) for trial in trials.values()}
    ids = {trial_id: copies[trial.number] for trial_id, trial in trials.items()}
    for key, value in old.get_study_user_attrs(source_id).items():
        new.set_study_user_attr(target_id, key, value)
    for key, value in old.get_study_system_attrs(source_id).items():
        new.set_study_system_attr(target_id, _renamed(key, ids), value)
    return copies


def _renamed(key: str, ids: Mapping[int, int]) -> str:
    match = _KEY_OF_TRIAL.fullmatch(key)
    if match is None or int(match[2]) not in ids:
        return key
    return f"{match[1]}{ids[int(match[2])]}{match[3]}"


def optuna_digest(database: Database, optuna_study_id: int) -> str:
    """Return the hex SHA-256 of the trials and attributes of an Optuna study; ids do not count."""
    storage = optuna_storage(database)
    trials = trials_by_id(storage, optuna_study_id)
    numbers = {trial_id: trial.number for trial_id, trial in trials.items()}
    notes = storage.get_study_system_attrs(optuna_study_id).items()
    return digest(
        {
            "trials": [_content(trial) for trial in trials.values()],
            "user": storage.get_study_user_attrs(optuna_study_id),
            "system": {_renamed(key, numbers): value for key, value in notes},
        }
    )


def _content(trial: "FrozenTrial") -> dict[str, Any]:
    from optuna.distributions import distribution_to_json

    return {
        "number": trial.number,
        "state": trial.state.name,
        "values": trial.values,
        "params": trial.params,
        "distributions": {name: json.loads(distribution_to_json(one)) for name, one in trial.distributions.items()},
        "user": trial.user_attrs,
        "system": trial.system_attrs,
        "intermediate": trial.intermediate_values,
        "times": [str(trial.datetime_start), str(trial.datetime_complete)],
    }
