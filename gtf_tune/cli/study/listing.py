"""List the studies of a storage."""

from typing import TYPE_CHECKING, Any

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Json, Storage, open_storage, storage_flag
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
    found = [(summary, _read(database, summary)) for summary in summaries]
    readable = [(summary, read) for summary, read in found if not isinstance(read, str)]
    for _, fault in found:
        if isinstance(fault, str):
            say(f"not listed: {fault}")
    if json:
        write_json([_as_json(summary, read) for summary, read in found])
    elif not summaries:
        say("no study yet; make one with: gtf-tune study create --help")
    elif readable:
        columns = ["study", "state", ">done/begun", ">nominal", ">best", "unit", ">time"]
        write_table(columns, [_row(summary, *read) for summary, read in readable])
        say(f"Next: gtf-tune study show {readable[-1][0].name}{storage_flag(database)}")


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
