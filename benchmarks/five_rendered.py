"""Compare a joint search of five options of GLOMAP with sweeps of each one, on images, for the same number of runs.

The rendered room is small and always there; the first frames of dtu-scan24 are searched too where GTF_TUNE_DATA names
the folder that holds it. Ground truth judges the picks and nothing else: no search sees it.
"""

import os
import tempfile
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks.images import DATA_VARIABLE, FIXED_OPTIONS, in_words, room
from benchmarks.section import Aim, Effort, Section, median
from gtf_tune.execution import LocalExecutor, StageCache
from gtf_tune.sequence import Selection, Sequence, load_sequence
from gtf_tune.store import ground_truth_errors
from gtf_tune.store import trials as stored_trials
from gtf_tune.store.database import Database, create_database
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import open_study
from gtf_tune.study.work.worker import StudyWorker

SPACE: Mapping[str, Mapping[str, Any]] = {
    "mapper.max_normalized_reproj_error": {"low": 2e-3, "high": 0.1, "log": True},
    "mapper.bundle_adjustment.ceres.loss_function_scale": {"low": 0.03, "high": 10.0, "log": True},
    "verification.ransac.max_error": {"low": 1.0, "high": 8.0, "log": True},
    "matching.sift.max_ratio": {"low": 0.65, "high": 0.85},
    "extraction.sift.peak_threshold": {"low": 2e-3, "high": 0.02, "log": True},
}
CLEAN_RUNS, NOISY_RUNS = 2, 4
SHARED = "dtu-scan24"
FRAMES = 16
"""First frames of the shared sequence that are used: with all of them a search takes more than an hour."""

SAMPLERS = ("refine", "tpe")
"""The default first."""

SEEDS = (0, 1, 2)
SEARCHES: Mapping[str, Mapping[str, Any]] = {
    **{name: {"sampler": "grid"} for name in SPACE},
    **{
        f"all five options, {sampler}, seed {seed}": {"sampler": sampler, "seed": seed}
        for sampler in SAMPLERS
        for seed in SEEDS
    },
}


@dataclass(frozen=True)
class Scene:
    """Images, and the noise that suits them in grey levels."""

    sequence: Sequence
    sigma: float


@dataclass(frozen=True)
class Picked:
    """The true ATE of nominal and of the pick of one search, in the unit of the ground truth, and its runs."""

    nominal: float
    picked: float
    runs: int

    @property
    def change(self) -> float:
        """Return by how many percent the pick changes the true ATE of nominal."""
        return 100.0 * (self.picked / self.nominal - 1.0)


def run(effort: Effort) -> Section:
    trials = effort.pick(16, 30)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        scenes = {one.sequence.name: one for one in _scenes(folder)}
        found = {name: search_scene(scene, trials, folder / name) for name, scene in scenes.items()}
    changes = {name: {search: one.change for search, one in searches.items()} for name, searches in found.items()}
    return section([in_words(one.sequence) for one in scenes.values()], trials, changes)


def section(scenes: Iterable[str], trials: int, changes: Mapping[str, Mapping[str, float]]) -> Section:
    """Return the table of changes of the true ATE in percent, by scene and search."""
    return Section(
        title="Five options of GLOMAP at once against sweeps of one",
        text=(
            f"GLOMAP on {'; '.join(scenes)}. Every search makes {trials} trials of {CLEAN_RUNS} clean and {NOISY_RUNS} "
            f"noisy runs, nominal included: a sweep is a grid over one option, the joint searches are by "
            f"{' and '.join(SAMPLERS)}, the first being the default, with seeds of their own for sampler and noise. "
            "Shown is by how much the pick changes the true ATE of nominal; ground truth serves to judge and for "
            "nothing else; a change of nearly -100 % means that nominal's own reconstruction fell apart. The best "
            "sweep is the best by that truth."
        ),
        header=("search", *changes),
        rows=tuple((name, *(f"{one[name]:+.1f} %" for one in changes.values())) for name in SEARCHES),
        aims=tuple(_aim(name, one, trials) for name, one in changes.items()),
        conclusion=_medians(changes),
    )


def _medians(changes: Mapping[str, Mapping[str, float]]) -> str:
    told = []
    for scene, one in changes.items():
        words = (f"{_median(one, sampler):+.1f} % by {sampler}" for sampler in SAMPLERS)
        told.append(f"{' and '.join(words)} on {scene}")
    return f"Median over the seeds: {'; '.join(told)}."


def _median(changes: Mapping[str, float], sampler: str) -> float:
    return median([changes[f"all five options, {sampler}, seed {seed}"] for seed in SEEDS])


def search_scene(scene: Scene, trials: int, folder: Path) -> dict[str, Picked]:
    """Do all searches of a scene and print each one at once: an interrupted benchmark keeps what it has measured."""
    folder.mkdir()
    database = create_database(str(folder / "studies.db"))
    found: dict[str, Picked] = {}
    cache = StageCache(folder / "cache")
    with LocalExecutor(jobs=os.cpu_count() or 1, stages=cache, scratch=folder / "scratch") as executor:
        for name, search in SEARCHES.items():
            definition = _definition(scene, name, {**search, "trials": trials})
            create_study(database, checked_definition(definition, definition["name"]), folder)
            StudyWorker(open_study(database, definition["name"]), executor).work()
            found[name] = _picked(database, definition["name"], trials)
            print(f"{scene.sequence.name}: {name}: true ATE {found[name].change:+.1f} %", flush=True)
    database.close()
    return found


def _scenes(folder: Path) -> list[Scene]:
    scenes = [Scene(room(folder), 5.0)]
    shared = Path(os.environ.get(DATA_VARIABLE, "")) / SHARED
    if os.environ.get(DATA_VARIABLE) and shared.is_dir():
        scenes.append(Scene(load_sequence(shared, SHARED, selection=Selection(max_frames=FRAMES)), 2.0))
    return scenes


def _definition(scene: Scene, name: str, search: Mapping[str, Any]) -> dict[str, Any]:
    space = {name: {**SPACE[name], "points": search["trials"] - 1}} if name in SPACE else dict(SPACE)
    return {
        "name": name.replace(",", "").replace(" ", "-"),
        "pipeline": {"name": "glomap", "options": FIXED_OPTIONS},
        "sequences": [{"name": "scene", "path": str(scene.sequence.root.resolve()), "max_frames": len(scene.sequence)}],
        "space": space,
        "gtf": {"clean_runs": CLEAN_RUNS, "noisy_runs": NOISY_RUNS, "noise_sigma": scene.sigma},
        "search": dict(search),
    }


def _picked(database: Database, name: str, trials: int) -> Picked:
    study = open_study(database, name)
    best = stored_trials.best(database, study.record.id)
    truth = {
        number: next(iter(one.values()))
        for number, one in ground_truth_errors.values(database, study.record.id).items()
    }
    nominal, picked = truth.get(0), truth.get(best.number if best else 0)
    if nominal is None or picked is None:
        raise RuntimeError(f"expected the true ATE of nominal and of the pick of '{name}'; see its log")
    return Picked(nominal, picked, trials * (CLEAN_RUNS + NOISY_RUNS))


def _aim(scene: str, changes: Mapping[str, float], trials: int) -> Aim:
    best, joint = min(SPACE, key=lambda name: changes[name]), _median(changes, SAMPLERS[0])
    met = joint <= changes[best]
    others = ", ".join(f"{_median(changes, sampler):+.1f} % by {sampler}" for sampler in SAMPLERS[1:])
    return Aim(
        wanted=f"five options at once beat the best sweep for the same number of runs on {scene}",
        measured=(
            f"{joint:+.1f} % by {SAMPLERS[0]}, median of {len(SEEDS)} seeds, against {changes[best]:+.1f} % by {best}, "
            f"{trials * (CLEAN_RUNS + NOISY_RUNS)} runs each"
        ),
        met=met,
        bound="" if met else f"Medians of the other samplers: {others}.",
    )
