"""List the studies of a storage."""

from typing import TYPE_CHECKING, Any

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Json, Storage
from gtf_tune.cli.storage_access import open_storage, storage_flag
from gtf_tune.cli.terminal.console import duration, say, write_json, write_table

if TYPE_CHECKING:
    from gtf_tune.display import ScoreUnit
    from gtf_tune.store.database import Database
    from gtf_tune.store.studies import StudySummary
    from gtf_tune.study.outcome.recommendation import Recommendation


def list_studies(json: Json = False, storage: Storage = DEFAULT_STORAGE) -> None:
    """List the studies of a storage.

    Example: gtf-tune study list
    """
    from gtf_tune.store import studies

    database = open_storage(storage)
    summaries = studies.summaries(database)
    found = {one.name: _read(database, one) for one in summaries}
    unreadable = {name: fault for name, fault in found.items() if isinstance(fault, str)}
    if json:
        write_json([_as_json(one, found[one.name]) for one in summaries])
    elif summaries:
        rows = [_row(one, *read) for one in summaries if not isinstance(read := found[one.name], str)]
        columns = ["study", "state", ">done/begun", ">nominal", ">best", "unit", ">time"]
        if rows:
            write_table(columns, rows)
    else:
        say("no study yet; make one with: gtf-tune study create --help")
    for fault in unreadable.values():
        say(f"not listed: {fault}")
    readable = [one.name for one in summaries if one.name not in unreadable]
    if readable and not json:
        say(f"Next: gtf-tune study show {readable[-1]}{storage_flag(database)}")


def _read(database: "Database", summary: "StudySummary") -> "tuple[ScoreUnit, Recommendation] | str":
    """Return what the row of a study needs, or why the study cannot be read."""
    from gtf_tune.display import definition_unit
    from gtf_tune.errors import GtfTuneError
    from gtf_tune.store import studies
    from gtf_tune.store.studies import stored_definition
    from gtf_tune.study.outcome.recommendation import recommend

    try:
        unit = definition_unit(stored_definition(summary))
        return unit, recommend(database, studies.get(database, summary.name))
    except GtfTuneError as error:
        return str(error)


def _row(summary: "StudySummary", unit: "ScoreUnit", found: "Recommendation") -> tuple[str, ...]:
    return (
        summary.name,
        summary.state,
        f"{summary.done}/{summary.trials}",
        unit.text(summary.nominal_value),
        unit.text(found.trial.value if found.trial else None),
        unit.symbol,
        duration(summary.wall_s),
    )


def _as_json(summary: "StudySummary", found: "tuple[ScoreUnit, Recommendation] | str") -> dict[str, Any]:
    facts = {key: value for key, value in vars(summary).items() if key != "definition"}
    if isinstance(found, str):
        return {**facts, "error": found}
    trial = found[1].trial
    return {
        **facts,
        "best_value": trial.value if trial else None,
        "verdict": found[1].decision,
        "recommended": trial.number if trial else None,
    }
