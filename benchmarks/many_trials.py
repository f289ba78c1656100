"""Time reading commands, and one more trial, on studies of 1,000 and 10,000 trials in SQLite."""

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from benchmarks.images import room
from benchmarks.replicate import replicate
from benchmarks.section import Aim, Effort, Section, median
from gtf_tune.execution import InlineExecutor
from gtf_tune.store.database import create_database, open_database
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.events import Event, TrialFinished, TrialStarted
from gtf_tune.study.open_study import open_study
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest
from gtf_tune.study.work.worker import StudyWorker

NAME = "many"
BASE = 10
SIZES = (BASE, 1_000, 10_000)
"""The smallest shows what a command takes before it has read anything worth mentioning."""
SMALLEST, SMALL, LARGE = SIZES
AIM_S = 1.0
COMMANDS: Mapping[str, Sequence[str]] = {
    "study list": ("study", "list"),
    "study show": ("study", "show", NAME),
    "study best": ("study", "best", NAME),
    "study export": ("study", "export", NAME, "--format", "csv"),
}
_COMMAND = "from gtf_tune.cli.main import main; main()"
_WATCH = """
import resource, subprocess, sys, time
began = time.perf_counter()
subprocess.run(sys.argv[1:], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
print(time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""


@dataclass(frozen=True)
class Cost:
    """What one command took: the wall time of its process in seconds, and its largest resident set in bytes."""

    wall_s: float
    memory_bytes: int


class StopAfterTrials:
    """Ask to stop after so many trials, and note when each began."""

    def __init__(self, count: int) -> None:
        self.stop = StopRequest()
        self.left = count
        self.times: list[float] = []

    def on_event(self, event: Event) -> None:
        if isinstance(event, TrialStarted):
            self.times.append(time.perf_counter())
        self.left -= isinstance(event, TrialFinished)
        if self.left <= 0:
            self.stop.ask(FINISH_RUNS)


def run(effort: Effort) -> Section:
    rounds = effort.pick(3, 7)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        base = make_base(folder)
        files = {size: _multiplied(base, folder, size) for size in SIZES}
        costs = {command: _costs(arguments, files, rounds) for command, arguments in COMMANDS.items()}
        start_s = median([_cost(("--help",), None).wall_s for _ in range(rounds)])
        next_s = {size: next_trial_s(path) for size, path in files.items()}
        sizes_mb = {size: path.stat().st_size / 1e6 for size, path in files.items()}
    slowest = max(costs, key=lambda command: costs[command][LARGE].wall_s)
    slowest_s, unread_s = costs[slowest][LARGE].wall_s, costs[slowest][SMALLEST].wall_s
    return Section(
        title="Studies of 10,000 trials",
        text=(
            "A study of the analytic pipeline with eight runs a trial, 50 poses a run, in SQLite; a small one is run "
            f"and its rows are multiplied. Wall times of whole commands, median of {rounds}, and their largest "
            f"memory. Starting Python and printing the help takes {start_s:.2f} s of each; a study of {BASE} trials "
            "shows what else a command takes whatever it reads, nearly all of it the import of libraries."
        ),
        header=("", *(f"{size:,} trials" for size in SIZES), f"{SMALL:,} to {LARGE:,}", f"memory at {LARGE:,}"),
        rows=(
            *(_row(command, cost) for command, cost in costs.items()),
            ("one more trial (TPE)", *(f"{next_s[size]:.2f} s" for size in SIZES), _growth(next_s), ""),
            ("file", *(f"{sizes_mb[size]:.0f} MB" for size in SIZES), _growth(sizes_mb), ""),
        ),
        aims=(
            Aim(
                wanted=f"reading commands under {AIM_S:g} s at 10,000 trials",
                measured=f"{slowest_s:.2f} s for the slowest, {slowest}",
                met=slowest_s < AIM_S,
                bound=(
                    ""
                    if slowest_s < AIM_S
                    else f"It takes {unread_s:.2f} s on {BASE} trials too (starting Python, importing SQLAlchemy, "
                    f"pydantic and typer); reading the others takes {slowest_s - unread_s:.2f} s."
                ),
            ),
        ),
    )


def make_base(folder: Path) -> Path:
    """Run the first trials of a large study and return its database file."""
    path = folder / "base.db"
    database = create_database(str(path))
    data = {
        "name": NAME,
        "pipeline": {"name": "analytic"},
        "sequences": [{"name": "room", "path": str(room(folder).root)}],
        "space": {
            "filter.max_error": {"low": 1e-3, "high": 1e-1, "log": True},
            "robust.scale": {"low": 0.01, "high": 10.0, "log": True},
        },
        "gtf": {"clean_runs": 2, "noisy_runs": 6, "noise_sigma": 5.0},
        "search": {"sampler": "tpe", "trials": 100_000},
    }
    create_study(database, checked_definition(data, NAME), folder)
    database.close()
    _work(path, BASE)
    return path


def next_trial_s(path: Path) -> float:
    """Return the wall time of one more trial, after one that reads the study into Optuna's cache."""
    database = open_database(str(path))
    stopping = StopAfterTrials(4)
    StudyWorker(open_study(database, NAME), InlineExecutor(), stopping.stop, [stopping.on_event]).work()
    database.close()
    return median([after - before for before, after in pairwise(stopping.times)])


def _work(path: Path, trials: int) -> None:
    database = open_database(str(path))
    stopping = StopAfterTrials(trials)
    StudyWorker(open_study(database, NAME), InlineExecutor(), stopping.stop, [stopping.on_event]).work()
    database.close()


def _multiplied(base: Path, folder: Path, size: int) -> Path:
    path = folder / f"{size}.db"
    shutil.copy(base, path)
    if size > BASE:
        replicate(path, size // BASE)
    return path


def _costs(arguments: Sequence[str], files: Mapping[int, Path], rounds: int) -> dict[int, Cost]:
    found: dict[int, list[Cost]] = {size: [] for size in files}
    for _ in range(rounds):
        for size, path in files.items():
            found[size].append(_cost(arguments, path))
    return {
        size: Cost(median([cost.wall_s for cost in costs]), max(cost.memory_bytes for cost in costs))
        for size, costs in found.items()
    }


def _cost(arguments: Sequence[str], storage: Path | None) -> Cost:
    command = [sys.executable, "-c", _COMMAND, *arguments, *(("--storage", str(storage)) if storage else ())]
    # A small process in between: the memory of a child counts from that of the process that started it.
    found = subprocess.run([sys.executable, "-c", _WATCH, *command], check=True, capture_output=True, text=True)
    wall_s, memory_kib = found.stdout.split()
    return Cost(float(wall_s), int(memory_kib) * 1024)


def _row(command: str, costs: Mapping[int, Cost]) -> tuple[str, ...]:
    walls = {size: cost.wall_s for size, cost in costs.items()}
    memory = f"{costs[LARGE].memory_bytes / 2**20:.0f} MiB"
    return (command, *(f"{walls[size]:.2f} s" for size in SIZES), _growth(walls), memory)


def _growth(values: Mapping[int, float]) -> str:
    return f"{values[LARGE] / values[SMALL]:.1f} x"
