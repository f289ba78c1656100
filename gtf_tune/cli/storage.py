"""Check, upgrade and copy storages."""

from typing import Annotated

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Json, Storage, StudyName, create_storage, hush_optuna, open_storage
from gtf_tune.cli.terminal.console import say, write_json, write_line, write_pairs


def check(json: Json = False, storage: Storage = DEFAULT_STORAGE) -> None:
    """Check tables, orphans and the digest of every trajectory; exit with 1 if something is wrong.

    Example: gtf-tune storage check
    """
    from gtf_tune.store.maintenance.check import check as check_database

    report = check_database(open_storage(storage))
    if json:
        write_json(vars(report))
    else:
        counts = {name: str(getattr(report, name)) for name in ("studies", "trials", "runs")}
        write_pairs({"revision": f"{report.revision} (Optuna {report.optuna_revision})", **counts})
        for line in (
            *(f"problem: {problem}" for problem in report.problems),
            *(f"note: {note}" for note in report.notes),
        ):
            write_line(line)
    if report.problems:
        raise typer.Exit(1)
    say("the storage is sound")


def upgrade(storage: Storage = DEFAULT_STORAGE) -> None:
    """Bring the tables of an older storage, and those of Optuna in it, to this version.

    A SQLite file is copied first; make a backup of a server's database yourself.

    Example: gtf-tune storage upgrade --storage old.db
    """
    from gtf_tune.store.database import upgrade_database

    database = upgrade_database(storage, say)
    say(f"{database.shown_url} has the tables of this version")


def copy(
    source: Annotated[str, typer.Argument(metavar="FROM", help="Storage to copy from.")],
    target: Annotated[str, typer.Argument(metavar="TO", help="Storage to copy to; made if need be.")],
    study: Annotated[str, typer.Option("--study", help="Name of the study.")],
) -> None:
    """Copy a study with all trials, runs, trajectories and notes, and verify the copy by its digest.

    Example: gtf-tune storage copy gtf-tune.db postgresql+psycopg://host/tuning --study photos
    """
    from gtf_tune.store.maintenance.copy import copy_study

    hush_optuna()
    digest = copy_study(open_storage(source), create_storage(target), study)
    say(f"copied study '{study}'; both have the digest {digest}")


def digest(name: StudyName, storage: Storage = DEFAULT_STORAGE) -> None:
    """Print the digest of what a study found: equal digests mean equal trials, scores and trajectories.

    Example: gtf-tune storage digest photos
    """
    from gtf_tune.store.maintenance.digest import study_digest

    write_line(study_digest(open_storage(storage), name))
