"""Tune one option on a rendered room, and compare the outcome with ground truth."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.parameters import CacheDir, Jobs, hush_optuna
from gtf_tune.cli.study.notes import suggest_outcome
from gtf_tune.cli.study.report import report
from gtf_tune.cli.terminal.console import number, percent, permille, say, write_line, write_pairs, write_table

if TYPE_CHECKING:
    from gtf_tune.store.database import Database
    from gtf_tune.store.studies import Study

_OPTION = "mapper.max_normalized_reproj_error"
_FEWEST_PAIRS = 3
_VALUES = (3e-4, 6e-4, 1e-3, 2e-3, 4e-3, 1e-2, 5e-2)


def demo(
    folder: Annotated[Path, typer.Option("--folder", help="Where images, database and report go.")] = Path(
        "gtf-tune-demo"
    ),
    jobs: Jobs = None,
    cache_dir: CacheDir = None,
) -> None:
    """Render a room, tune one GLOMAP option on it without ground truth, and check the outcome against the truth.

    Example: gtf-tune demo
    """
    from gtf_tune.cli.parameters import default_jobs, make_executor
    from gtf_tune.cli.study.run import work_on
    from gtf_tune.sequence import render_room
    from gtf_tune.store import studies
    from gtf_tune.store.database import create_database
    from gtf_tune.study.create import checked_definition, create_study
    from gtf_tune.study.open_study import open_study

    hush_optuna()
    room = folder / "room"
    if not (room / "groundtruth.txt").exists():
        say(f"rendering a room into {room}")
        render_room(room)
    database = create_database(str(folder / "demo.db"))
    say(f"storage: {database.shown_url}")
    if "demo" not in studies.names(database):
        definition = checked_definition(_definition(), "demo")
        create_study(database, definition, folder.absolute())
    study = open_study(database, "demo")
    work_on(study, make_executor(jobs or default_jobs(), cache_dir), trial_parallel=1)
    _write_outcome(database, study.record)
    report(study.definition.name, folder / "report.html", storage=str(folder / "demo.db"))
    suggest_outcome(database, "demo")


def _definition() -> dict[str, Any]:
    return {
        "name": "demo",
        "pipeline": {
            "name": "glomap",
            "options": {
                "mapper.bundle_adjustment.refine_focal_length": False,
                "mapper.bundle_adjustment.refine_extra_params": False,
            },
        },
        "sequences": [{"name": "room", "path": "room"}],
        "space": {_OPTION: {"values": list(_VALUES)}},
        "gtf": {"clean_runs": 2, "noisy_runs": 4, "noise_sigma": 4.0},
        "search": {"sampler": "grid"},
    }


def _write_outcome(database: "Database", study: "Study") -> None:
    """Print every trial beside its error against ground truth, and how far the score agrees with it."""
    from scipy.stats import spearmanr

    from gtf_tune.store import ground_truth_errors, trials
    from gtf_tune.study.outcome.recommendation import recommend

    known = [trial for trial in trials.of_study(database, study.id) if trial.value is not None]
    recorded = ground_truth_errors.of_study(database, study.id)
    truth = {number: errors[0].ate for number, errors in recorded.items() if errors[0].ate is not None}
    found = recommend(database, study)
    best = found.trial.number if found.trial else None
    rows = [
        (
            number(float((trial.options or {})[_OPTION])),
            permille(trial.gtf_ate),
            permille(trial.standard_error),
            number(truth.get(trial.number)),
            _marks(trial.number, best),
        )
        for trial in sorted(known, key=lambda trial: (trial.options or {})[_OPTION])
    ]
    write_table([f">{_OPTION}", ">GTF ATE [‰]", ">± se", ">ground-truth ATE", ""], rows)
    write_pairs({"verdict": found.text})
    if best is not None and {0, best} <= truth.keys():
        least = min(truth.values()) / truth[0] - 1
        write_line(f"ground-truth ATE of that trial, which the search never saw: {percent(truth[best] / truth[0] - 1)}")
        write_line(f"the best that ground truth itself would have found: {percent(least)}")
    pairs = [(trial.gtf_ate, truth[trial.number]) for trial in known if trial.gtf_ate and trial.number in truth]
    rank = f"{spearmanr(*zip(*pairs, strict=True)).statistic:+.2f}" if len(pairs) >= _FEWEST_PAIRS else "-"
    write_line(f"rank correlation of GTF ATE and ground-truth ATE over {len(pairs)} trials: {rank}")


def _marks(number: int, best: int | None) -> str:
    return ", ".join(word for word, marked in (("nominal", 0), ("best", best)) if number == marked)
