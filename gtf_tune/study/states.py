"""Pause, stop and reopen a study; workers everywhere heed it."""

from gtf_tune.errors import StorageError
from gtf_tune.store import studies
from gtf_tune.store.database import Database
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
    check_whole(study)
    if study.state != "open":
        studies.set_state(database, study.id, "open")
    return studies.get(database, name)


def check_open(study: Study) -> None:
    """Raise `StorageError` unless a study may be worked on; one that is done may, and is at once.

    Raises
    ------
    StorageError
        The study is paused, stopped, or an unfinished copy.
    """
    check_whole(study)
    if study.state not in ("open", "done"):
        raise StorageError(f"study '{study.name}' is {study.state}; open it with 'gtf-tune study resume {study.name}'")


def check_whole(study: Study) -> None:
    """Raise `StorageError` for an unfinished copy of a study."""
    if study.state == "copying":
        raise StorageError(
            f"study '{study.name}' is an unfinished copy; delete it with 'gtf-tune study delete {study.name}' and copy "
            "it again"
        )


def _close(database: Database, name: str, state: studies.StudyState) -> None:
    study = studies.get(database, name)
    if study.state in ("done", "copying"):
        raise StorageError(f"study '{name}' is {study.state}, so there is nothing to stop; see 'gtf-tune study show'")
    studies.set_state(database, study.id, state)
