"""Measure the wall time of a study that its pipeline does not account for, per run."""

import tempfile
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.images import FIXED_OPTIONS, fountain, in_words, room
from benchmarks.section import Aim, Effort, Section
from gtf_tune.execution import LocalExecutor, StageCache
from gtf_tune.sequence import Sequence
from gtf_tune.store.database import create_database
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.events import Event, RunFinished, ignore
from gtf_tune.study.open_study import open_study
from gtf_tune.study.work.worker import StudyWorker

AIM_MS = 50.0
AIM_SHARE = 0.02


class RunTimes:
    """Sums of what runs took, in their process and inside the pipeline's own stages."""

    def __init__(self) -> None:
        self.runs = 0
        self.in_process_s = 0.0
        self.in_stages_s = 0.0

    def on_event(self, event: Event) -> None:
        if not isinstance(event, RunFinished):
            return
        run = event.run.stored
        self.runs += 1
        self.in_process_s += run.wall_s
        stages = [float(value) for name, value in run.diagnostics.items() if name.endswith("_s")]
        self.in_stages_s += sum(stages) if stages else run.wall_s


@dataclass(frozen=True)
class StudyTime:
    """The wall time of a study by where it went, in seconds per run."""

    runs: int
    wall_s: float
    in_process_s: float
    in_stages_s: float
    outside_ms: float = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "outside_ms", 1e3 * (self.wall_s - self.in_stages_s) / self.runs)

    @property
    def share(self) -> float:
        """Return the part of the wall time that is outside the stages."""
        return 1.0 - self.in_stages_s / self.wall_s


def run(effort: Effort) -> Section:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        images = room(folder)
        analytic = time_study(folder, _analytic(images), effort.pick(30, 100))
        found = {f"glomap, {images.name}": time_study(folder, _glomap(images), effort.pick(3, 8))}
        photographs = fountain()
        if photographs:
            found[f"glomap, {photographs.name}"] = time_study(folder, _glomap(photographs), effort.pick(1, 3))
    return Section(
        title="Overhead: wall time outside the pipeline",
        text=(
            f"A study on {in_words(images)}{_and(photographs)} with one job, on SQLite, by "
            "TPE: wall time per run, the part of it inside "
            "the run's process, and what remains outside the stages of the pipeline: asking the sampler, starting the "
            "run, checking cached stages, scoring, storing. The analytic pipeline computes its result in well under a "
            "millisecond."
        ),
        header=("pipeline", "runs", "a run", "in its process", "outside the stages"),
        rows=tuple(_row(name, one) for name, one in {"analytic": analytic, **found}.items()),
        aims=(
            _aim(
                f"at most {AIM_MS:g} ms a run", f"{analytic.outside_ms:.0f} ms", analytic, analytic.outside_ms <= AIM_MS
            ),
            *(
                _aim(f"at most {AIM_SHARE:.0%} of a run of {name}", f"{one.share:.1%}", one, one.share <= AIM_SHARE)
                for name, one in found.items()
            ),
        ),
    )


def time_study(folder: Path, definition: Mapping[str, Any], trials: int) -> StudyTime:
    """Run a study of so many trials after one that warms up, and return where its time went."""
    database = create_database(str(folder / f"{definition['name']}.db"))
    times = RunTimes()
    with LocalExecutor(stages=StageCache(folder / "cache"), scratch=folder / "scratch") as executor:
        studies = (("warm-up", 1, ignore), (definition["name"], trials, times.on_event))
        for seed, (name, count, callback) in enumerate(studies):  # other seeds, so that no run is there already
            data = {**definition, "name": name, "search": {"sampler": "tpe", "trials": count, "seed": seed}}
            create_study(database, checked_definition(data, name), folder)
            study = open_study(database, name)
            began = time.perf_counter()
            StudyWorker(study, executor, callbacks=[callback]).work()
            wall_s = time.perf_counter() - began
    database.close()
    return StudyTime(times.runs, wall_s, times.in_process_s, times.in_stages_s)


def _analytic(images: Sequence) -> dict[str, Any]:
    return {
        "name": "analytic",
        "pipeline": {"name": "analytic"},
        "sequences": [{"name": "room", "path": str(images.root)}],
        "space": {"robust.scale": {"low": 0.01, "high": 10.0, "log": True}},
        "gtf": {"clean_runs": 2, "noisy_runs": 6, "noise_sigma": 5.0},
    }


def _glomap(images: Sequence) -> dict[str, Any]:
    return {
        "name": f"glomap-{len(images)}",
        "pipeline": {"name": "glomap", "options": FIXED_OPTIONS},
        "sequences": [{"name": "room", "path": str(images.root.resolve())}],
        "space": {"mapper.max_normalized_reproj_error": {"low": 2e-3, "high": 0.1, "log": True}},
        "gtf": {"clean_runs": 2, "noisy_runs": 6, "noise_sigma": 5.0},
    }


def _and(photographs: Sequence | None) -> str:
    return f", and on {in_words(photographs)}," if photographs else ""


def _row(name: str, found: StudyTime) -> tuple[str, ...]:
    each = (found.wall_s / found.runs, found.in_process_s / found.runs)
    return (name, str(found.runs), *(f"{1e3 * one:.1f} ms" for one in each), f"{found.outside_ms:.1f} ms")


def _aim(wanted: str, measured: str, found: StudyTime, met: bool) -> Aim:
    outside = (found.wall_s - found.in_process_s) / (found.wall_s - found.in_stages_s)
    bound = "" if met else f"{outside:.0%} of it is outside the run's process: asking, starting, scoring, storing."
    return Aim(wanted, measured, met, bound)
