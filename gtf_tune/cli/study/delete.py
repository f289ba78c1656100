"""Delete a study."""

from typing import Annotated

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Storage, StudyName, open_storage
from gtf_tune.cli.terminal.console import say


def delete(
    name: StudyName,
    yes: Annotated[bool, typer.Option("--yes", help="Do not ask.")] = False,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Delete a study with its trials, and the runs that no other study uses.

    Example: gtf-tune study delete photos --yes
    """
    from gtf_tune.store import studies

    database = open_storage(storage)
    study = studies.get(database, name)
    if not yes:
        typer.confirm(f"Delete study '{study.name}' with all of its trials and runs?", abort=True, err=True)
    studies.delete_study(database, name)
    say(f"deleted study '{name}'")
