"""Look at a study under another score, and extend it."""

import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Json, Storage, StudyName
from gtf_tune.cli.storage_access import hush_optuna, open_storage, storage_flag
from gtf_tune.cli.study.create import Range, parse_range
from gtf_tune.cli.study.notes import STOPPED_EARLY
from gtf_tune.cli.study.run import Places, place_folders
from gtf_tune.cli.terminal.console import percent, say, write_json, write_line, write_options, write_table
from gtf_tune.cli.true_errors import Side, TrueErrors
from gtf_tune.cli.values import parse_pairs, split_pairs

if TYPE_CHECKING:
    from gtf_tune.display import ScoreUnit
    from gtf_tune.store.database import Database
    from gtf_tune.store.studies import Study
    from gtf_tune.study.scoring.rescore import Rescored, RescoredTrial

Aggregate = Annotated[str | None, typer.Option("--aggregate", help="mean, median, gmean or trimmed.")]
Metric = Annotated[str | None, typer.Option("--metric", help="ate, rpe_translation or rpe_rotation.")]
Alignment = Annotated[str | None, typer.Option("--alignment", help="sim3, se3 or none.")]
Normalise = Annotated[str | None, typer.Option("--normalise", help="extent or none.")]
RpeDelta = Annotated[float | None, typer.Option("--rpe-delta", help="Distance between the poses of a pair.")]
RpeDeltaUnit = Annotated[str | None, typer.Option("--rpe-delta-unit", help="frames, seconds or metres.")]
RpePairs = Annotated[str | None, typer.Option("--rpe-pairs", help="all or consecutive.")]
Trials = Annotated[int | None, typer.Option("--trials", "-n", min=1, help="New total of trials, nominal included.")]
NoisyRuns = Annotated[int | None, typer.Option("--noisy-runs", "-K", min=1, help="Another k_delta; needs --as.")]
NewName = Annotated[str | None, typer.Option("--as", help="Make a new study on the same runs instead.")]


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


def extend(
    name: StudyName,
    trials: Trials = None,
    noisy_runs: NoisyRuns = None,
    range_: Range = None,
    new_name: NewName = None,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Give a study more trials or wider ranges; what would make trials incomparable needs a new name.

    A new study under --as takes over every run that is the same, so nothing is computed twice.

    Example: gtf-tune study extend photos --trials 80
    """
    from gtf_tune.study.edit import Extension, derive_study, extend_study
    from gtf_tune.study.open_study import trials_left

    hush_optuna()
    database = open_storage(storage)
    axes = {option: parse_range(option, bounds) for option, bounds in split_pairs(range_, "--range").items()}
    extension = Extension(trials, noisy_runs, axes)
    if new_name is None:
        extended = extend_study(database, name, extension)
        say(f"extended study '{name}'; workers that are at it now notice when they are started again")
        if not trials_left(database, extended):
            _say_nothing_is_left(extended, bool(axes), storage_flag(database))
            return
        if extended.state != "open":
            say(f"it stays {extended.state} until it is resumed")
            say(f"Next: gtf-tune study resume {name}{storage_flag(database)}")
            return
    else:
        derive_study(database, name, extension, new_name)
        say(f"created study '{new_name}' on the runs of '{name}'")
    say(f"Next: gtf-tune study run {new_name or name}{storage_flag(database)}")


def _say_nothing_is_left(study: "Study", has_wider_range: bool, flag: str) -> None:
    """Say on stderr why an extended study has no trial to do, and how to give it some."""
    from gtf_tune.store.studies import stored_definition

    if stored_definition(study).search.sampler == "grid":
        say("every point of its grid has its trial already; a new study on the same runs may have more of them")
        say(f"Next: gtf-tune study extend {study.name} --as NEW-NAME --range NAME=LOW:HIGH{flag}")
        return
    new = "nothing searches the new range yet" if has_wider_range else "it has nothing to do yet"
    say(f"all of its trials are done, so {new}; give it more trials")
    say(f"Next: gtf-tune study extend {study.name} --trials N{flag}")


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
    by_trial = {number: {one.sequence_name: one.value for one in errors} for number, errors in found.items()}
    return TrueErrors(changed, by_trial)


def _write(found: "Rescored", truth: TrueErrors, unit: "ScoreUnit") -> None:
    gtf = found.gtf
    say(f"score: {gtf.score_text}; the study is unchanged")
    nominal = found.trials[0].score
    rows = []
    for one in sorted(found.trials, key=lambda one: (one.rank or math.inf, one.trial.number)):
        change = percent(one.score.value / nominal.value - 1) if nominal.feasible and one.score.feasible else "-"
        rows.append(
            (
                str(one.trial.number),
                str(one.rank or "-"),
                str(one.rank_before or "-"),
                f"{unit.text(one.score.value)}{_mark(one)}" if one.score.feasible else "infeasible",
                change,
                "-" if math.isnan(one.score.collapse_rate) else f"{one.score.collapse_rate:.0%}",
                *truth.cells(one.trial.number),
            )
        )
    title = f">{unit.name} [{unit.short}]"
    write_table([">trial", ">rank", ">before", title, ">vs nominal", ">collapsed", *truth.columns], rows)
    if any(_mark(one) for one in found.trials):
        write_line(STOPPED_EARLY)
    if found.best is not None:
        write_options(found.best.trial.options or {})


def _as_json(found: "Rescored", truth: TrueErrors) -> dict[str, Any]:
    return {
        "gtf": found.gtf.model_dump(mode="json"),
        "side_metric": truth.side.model_dump(mode="json"),
        "best": found.best.trial.number if found.best else None,
        "trials": [
            {
                "ordinal": one.trial.number,
                "options": dict(one.trial.options or {}),
                "value_before": one.trial.value,
                "rank_before": one.rank_before or None,
                "value": one.score.value,
                "confidence_interval": list(one.score.confidence_interval),
                "rank": one.rank or None,
                "feasible": one.score.feasible,
                "collapse_rate": one.score.collapse_rate,
                **truth.as_json(one.trial.number),
            }
            for one in found.trials
        ],
    }


def _mark(one: "RescoredTrial") -> str:
    return "*" if one.trial.state == "pruned" else ""
