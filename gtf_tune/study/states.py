"""Pause, stop and reopen a study; its workers look at the state before every trial and with every heartbeat."""

from gtf_tune.errors import StorageError
from gtf_tune.store import studies
from gtf_tune.store.database import Database
from gtf_tune.store.retry import reopen_failed
from gtf_tune.store.studies import Study


def pause_study(database: Database, name: str) -> None:
    """Let workers finish the trials in work and take no new one."""
    _close(database, name, "paused")


def stop_study(database: Database, name: str) -> None:
    """Let workers finish the runs in flight, keep them, and give their trials back unfinished."""
    _close(database, name, "stopped")


def reopen_study(database: Database, name: str) -> Study:
    """Return a study after opening it for workers again.

    Raises
    ------
    StorageError
        There is no such study, or it is an unfinished copy.
    """
    study = studies.get(database, name)
    studies.check_whole(study)
    if study.state != "open":
        studies.set_state(database, study.id, "open")
    return studies.get(database, name)


def retry_failed(database: Database, name: str) -> int:
    """Open a study again for its trials whose runs failed, and return how many these are.

    Raises
    ------
    StorageError
        There is no such study, it is an unfinished copy, or no run of it failed.
    """
    study = studies.get(database, name)
    studies.check_whole(study)
    reopened = reopen_failed(database, study.id)
    if not reopened:
        raise StorageError(f"no trial of study '{name}' has a failed run, so there is nothing to retry")
    studies.set_state(database, study.id, "open")
    return reopened


def _close(database: Database, name: str, state: studies.StudyState) -> None:
    study = studies.get(database, name)
    if study.state in ("done", "copying"):
        raise StorageError(
            f"study '{name}' is {study.state}, so there is nothing to stop; look at what it found",
            remedy=("show it", name),
        )
    studies.set_state(database, study.id, state)
