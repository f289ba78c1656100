"""Show the trials of a study under another score."""

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Json, Storage, StudyName, open_storage
from gtf_tune.cli.study.notes import STOPPED_EARLY
from gtf_tune.cli.study.run import Places, place_folders
from gtf_tune.cli.study.true_errors import Side, TrueErrors
from gtf_tune.cli.terminal.console import say, write_json, write_line, write_options, write_table
from gtf_tune.cli.values import parse_pairs

if TYPE_CHECKING:
    from gtf_tune.display import ScoreUnit
    from gtf_tune.store.database import Database
    from gtf_tune.study.outcome.improvement import Improvement
    from gtf_tune.study.scoring.rescore import Rescored, RescoredTrial

Aggregate = Annotated[str | None, typer.Option("--aggregate", help="mean, median, gmean or trimmed.")]
Metric = Annotated[str | None, typer.Option("--metric", help="ate, rpe_translation or rpe_rotation.")]
Alignment = Annotated[str | None, typer.Option("--alignment", help="sim3, se3 or none.")]
Normalise = Annotated[str | None, typer.Option("--normalise", help="extent or none.")]
RpeDelta = Annotated[
    float | None, typer.Option("--rpe-delta", min=1e-9, max=1e9, help="Distance between the poses of a pair.")
]
RpeDeltaUnit = Annotated[str | None, typer.Option("--rpe-delta-unit", help="frames, seconds or metres.")]
RpePairs = Annotated[str | None, typer.Option("--rpe-pairs", help="all or consecutive.")]


def rescore(
    name: StudyName,
    aggregate: Aggregate = None,
    metric: Metric = None,
    alignment: Alignment = None,
    normalise: Normalise = None,
    rpe_delta: RpeDelta = None,
    rpe_delta_unit: RpeDeltaUnit = None,
    rpe_pairs: RpePairs = None,
    side: Side = None,
    places: Places = None,
    json: Json = False,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Show how the trials would rank under another score or error against ground truth, from stored trajectories.

    Nothing is run, and the study keeps its scores.

    Example: gtf-tune study rescore photos --aggregate median
    """
    from gtf_tune.display import definition_unit
    from gtf_tune.store import studies
    from gtf_tune.store.studies import stored_definition
    from gtf_tune.study.scoring.rescore import rescore as rescore_study

    database = open_storage(storage)
    given: dict[str, Any] = {"aggregate": aggregate, "metric": metric, "alignment": alignment, "normalise": normalise}
    given |= {"rpe_delta": rpe_delta, "rpe_delta_unit": rpe_delta_unit, "rpe_pairs": rpe_pairs}
    found = rescore_study(database, name, {key: value for key, value in given.items() if value is not None})
    truth = _true_errors(database, name, side, places)
    if json:
        write_json(_as_json(found, truth))
    else:
        definition = stored_definition(studies.get(database, name))
        _write(found, truth, definition_unit(definition.model_copy(update={"gtf": found.gtf})))


def _true_errors(database: "Database", name: str, side: list[str] | None, places: list[str] | None) -> TrueErrors:
    """Return the stored side metric of a study, or another one, computed from its trajectories."""
    from gtf_tune.store import ground_truth_errors, studies
    from gtf_tune.store.studies import stored_definition
    from gtf_tune.study.ground_truth.record import changed_side_metric, recompute_side_metric

    study = studies.get(database, name)
    stored = stored_definition(study).side_metric
    if not side:
        return TrueErrors(stored, ground_truth_errors.values(database, study.id))
    changed = changed_side_metric(stored, parse_pairs(side, "--side"))
    found = recompute_side_metric(database, name, changed, place_folders(places))
    by_trial = {number: {error.sequence_name: error.value for error in errors} for number, errors in found.items()}
    return TrueErrors(changed, by_trial)


def _write(found: "Rescored", truth: TrueErrors, unit: "ScoreUnit") -> None:
    say(f"score: {found.gtf.score_text}; the study is unchanged")
    improvements = _improvements(found)
    ranked = sorted(found.trials, key=lambda rescored: (rescored.rank or math.inf, rescored.trial.number))
    rows = [
        (
            str(rescored.trial.number),
            str(rescored.rank or "-"),
            str(rescored.rank_before or "-"),
            f"{unit.text(rescored.score.value)}{_mark(rescored)}" if rescored.score.feasible else "infeasible",
            improvements[rescored.trial.number].change,
            "-" if math.isnan(rescored.score.collapse_rate) else f"{rescored.score.collapse_rate:.0%}",
            *truth.cells(rescored.trial.number),
        )
        for rescored in ranked
    ]
    title = f">{unit.name} [{unit.short}]"
    write_table([">trial", ">rank", ">before", title, ">vs nominal", ">collapsed", *truth.columns], rows)
    if any(_mark(rescored) for rescored in found.trials):
        write_line(STOPPED_EARLY)
    if found.best is not None:
        write_line(f"first by this score: trial {found.best.trial.number}")
        write_options(found.best.trial.options or {})


def _improvements(found: "Rescored") -> "dict[int, Improvement]":
    """Return the paired improvement of each trial on nominal under the new score, by number."""
    from gtf_tune.study.outcome.improvement import UNKNOWN_IMPROVEMENT, paired_improvement, score_matrices

    nominal = score_matrices(found.trials[0].score)
    improvements = {
        rescored.trial.number: paired_improvement(nominal, score_matrices(rescored.score))
        for rescored in found.trials[1:]
    }
    return {found.trials[0].trial.number: UNKNOWN_IMPROVEMENT, **improvements}


def _as_json(found: "Rescored", truth: TrueErrors) -> dict[str, Any]:
    improvements = _improvements(found)
    return {
        "gtf": found.gtf.model_dump(mode="json"),
        "side_metric": truth.side.model_dump(mode="json"),
        "best": found.best.trial.number if found.best else None,
        "trials": [
            {
                "ordinal": rescored.trial.number,
                "options": dict(rescored.trial.options or {}),
                "value_before": rescored.trial.value,
                "rank_before": rescored.rank_before or None,
                "value": rescored.score.value,
                "confidence_interval": list(rescored.score.confidence_interval),
                "improvement": improvements[rescored.trial.number].as_json(),
                "rank": rescored.rank or None,
                "feasible": rescored.score.feasible,
                "collapse_rate": rescored.score.collapse_rate,
                **truth.as_json(rescored.trial.number),
            }
            for rescored in found.trials
        ],
    }


def _mark(rescored: "RescoredTrial") -> str:
    return "*" if rescored.trial.state == "pruned" else ""
