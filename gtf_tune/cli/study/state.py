"""Pause and stop the work on a study wherever it goes on, and have failed runs tried again."""

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Storage, StudyName, open_storage, storage_flag
from gtf_tune.cli.terminal.console import say


def pause(name: StudyName, storage: Storage = DEFAULT_STORAGE) -> None:
    """Let every worker finish its trial of a study and take no new one.

    Example: gtf-tune study pause photos
    """
    from gtf_tune.study.states import pause_study

    database = open_storage(storage)
    pause_study(database, name)
    say(f"study '{name}' is paused: trials in work are finished")
    say(f"Next: gtf-tune study resume {name}{storage_flag(database)}")


def stop(name: StudyName, storage: Storage = DEFAULT_STORAGE) -> None:
    """Let every worker finish its runs in flight, keep them, and leave a study.

    Example: gtf-tune study stop photos
    """
    from gtf_tune.study.states import stop_study

    database = open_storage(storage)
    stop_study(database, name)
    say(f"study '{name}' is stopped: runs in flight are kept")
    say(f"Next: gtf-tune study resume {name}{storage_flag(database)}")


def retry_failed(name: StudyName, storage: Storage = DEFAULT_STORAGE) -> None:
    """Take back the verdicts of trials whose runs failed, so that these runs are tried again.

    For failures that the machine caused and that are gone now. Runs that worked are kept.

    Example: gtf-tune study retry-failed photos
    """
    from gtf_tune.study.states import retry_failed

    database = open_storage(storage)
    count = retry_failed(database, name)
    say(f"study '{name}': {count} trial{'s' if count > 1 else ''} with failed runs will be tried again")
    say(f"Next: gtf-tune study run {name}{storage_flag(database)}")
