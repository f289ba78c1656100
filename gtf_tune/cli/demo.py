"""Tune on a rendered room with `gtf-tune tune`, and compare the outcome with ground truth."""

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.parameters import CacheDir, Jobs
from gtf_tune.cli.terminal.console import number, percent, permille, say, write_line, write_table
from gtf_tune.cli.tune import tune

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gtf_tune.pipelines import OptionValue
    from gtf_tune.store.database import Database
    from gtf_tune.store.studies import Study

_MINUTES, _LEAST_MINUTES = 3.0, 1.0
_DEFINITION = """\
name = "demo"

[pipeline]
name = "glomap"

[pipeline.options]
"mapper.bundle_adjustment.refine_focal_length" = false
"mapper.bundle_adjustment.refine_extra_params" = false

[[sequences]]
name = "room"
path = "room"
"""


def demo(
    folder: Annotated[Path, typer.Option("--folder", help="Where images, database, models and report go.")] = Path(
        "gtf-tune-demo"
    ),
    jobs: Jobs = None,
    cache_dir: CacheDir = None,
) -> None:
    """Render a room, tune GLOMAP on it for three minutes without ground truth, and check the outcome against it.

    Example: gtf-tune demo
    """
    from gtf_tune.sequence import render_room
    from gtf_tune.store import studies
    from gtf_tune.store.database import open_database

    began, room = time.monotonic(), folder / "room"
    if not (room / "groundtruth.txt").exists():
        say(f"rendering a room into {room}")
        render_room(room)
    definition, storage = folder / "demo.toml", str(folder / "demo.db")
    definition.write_text(_DEFINITION)
    minutes = max(_MINUTES - (time.monotonic() - began) / 60, _LEAST_MINUTES)
    say(f"gtf-tune tune {definition} --minutes {minutes:.2g} --storage {storage}")
    tune(definition, minutes, jobs=jobs, cache_dir=cache_dir, storage=storage)
    database = open_database(storage)
    write_truth(database, studies.get(database, studies.names(database)[-1]))


def write_truth(database: "Database", study: "Study") -> None:
    """Print every trial of a study beside its error against ground truth, and what the trial to use is by that."""
    from gtf_tune.store import ground_truth_errors, trials
    from gtf_tune.study.outcome.recommendation import recommend

    known = [trial for trial in trials.of_study(database, study.id) if trial.value is not None]
    recorded = ground_truth_errors.of_study(database, study.id)
    truth = {trial: errors[0].ate for trial, errors in recorded.items() if errors[0].ate is not None}
    chosen = recommend(database, study).trial
    marks = {0: "nominal", **({chosen.number: "to use"} if chosen else {})}
    usual = next((trial.options or {} for trial in known if trial.number == 0), {})
    rows = [
        (
            str(trial.number),
            _changes(trial.options or {}, usual),
            permille(trial.gtf_ate),
            number(truth.get(trial.number)),
            marks.get(trial.number, ""),
        )
        for trial in known
    ]
    write_table([">trial", "options", ">GTF ATE [‰]", ">ground-truth ATE", ""], rows)
    if chosen is not None and {0, chosen.number} <= truth.keys():
        change, least = truth[chosen.number] / truth[0] - 1, min(truth.values()) / truth[0] - 1
        write_line(f"ground-truth ATE of the trial to use, which the search never saw: {percent(change)}")
        write_line(f"the best trial by ground truth itself: {percent(least)}")


def _changes(options: "Mapping[str, OptionValue]", usual: "Mapping[str, OptionValue]") -> str:
    from gtf_tune.pipelines import option_text

    changed = {name.rpartition(".")[2]: value for name, value in options.items() if value != usual.get(name)}
    return ", ".join(f"{name}={option_text(value)}" for name, value in changed.items()) or "-"
