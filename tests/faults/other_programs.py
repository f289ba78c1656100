"""What optuna-dashboard and other programs do to Optuna's rows of a database that gtf-tune works on."""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import optuna
from optuna.distributions import FloatDistribution
from optuna.trial import TrialState, create_trial
from sqlalchemy import text

from gtf_tune.store.database import Database
from gtf_tune.store.optuna.tables import optuna_storage


def load(database: Database, name: str = "small") -> optuna.Study:
    return optuna.load_study(study_name=name, storage=optuna_storage(database))


def rename(database: Database, name: str = "small", new_name: str = "renamed") -> None:
    """Copy a study under a new name and delete the old one, as `Rename` of optuna-dashboard does."""
    study = load(database, name)
    copy = optuna.create_study(study_name=new_name, storage=optuna_storage(database), directions=study.directions)
    copy.add_trials(study.get_trials(deepcopy=False))
    for key, value in study.user_attrs.items():
        copy.set_user_attr(key, value)
    optuna_storage(database).delete_study(study._study_id)


def rename_in_place(database: Database) -> None:
    with database.engine.begin() as connection:
        connection.execute(text("UPDATE studies SET study_name = 'renamed'"))


def delete(database: Database, name: str = "small") -> None:
    optuna_storage(database).delete_study(load(database, name)._study_id)


def delete_and_reuse_the_id(database: Database) -> None:
    """Delete the study and create another one, which has the same id on SQLite, and trials with the same ids."""
    delete(database)
    other = optuna.create_study(study_name="small", storage=optuna_storage(database))
    for value in range(12):
        other.add_trial(create_trial(value=float(value), params={}, distributions={}))


def add_trials(database: Database) -> None:
    """Add trials of every state: without options, with other ones, and with ours out of their range."""
    study = load(database)
    study.add_trial(create_trial(state=TrialState.RUNNING))
    study.add_trial(create_trial(state=TrialState.FAIL))
    for name, value, kind in (
        ("other", 1.0, FloatDistribution(0, 2)),
        ("filter.max_error", 900.0, FloatDistribution(800, 1000, log=True)),
    ):
        study.add_trial(create_trial(value=-1.0, params={name: value}, distributions={name: kind}))


def change_attributes(database: Database) -> None:
    """Change user attributes of the study, delete those of its trials, and all that the dashboard shows."""
    study = load(database)
    study.set_user_attr("pipeline", {"not": ["a", "text"]})
    with database.engine.begin() as connection:
        connection.execute(text("DELETE FROM trial_user_attributes"))
        connection.execute(text("DELETE FROM study_system_attributes"))


DISTURBANCES: Mapping[str, Callable[[Database], None]] = MappingProxyType(
    {
        "renamed": rename,
        "renamed in place": rename_in_place,
        "foreign trials": add_trials,
        "attributes changed": change_attributes,
        "deleted": delete,
        "id reused": delete_and_reuse_the_id,
    }
)
"""The last two leave nothing that the search could go on with."""
