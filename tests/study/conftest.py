"""Small studies of the analytic pipeline: real loop, real database, no images worth the name."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from gtf_tune.execution import InlineExecutor
from gtf_tune.pipelines import analytic
from gtf_tune.store.database import Database, create_database
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import open_study
from gtf_tune.study.work.worker import StudyWorker
from gtf_tune.trajectory import write_tum

FRAMES = 12


def write_sequence(folder: Path, *, ground_truth: bool, frames: int = FRAMES) -> Path:
    """Write a sequence in the ETH3D layout: tiny grey images that differ, and the analytic pipeline's truth."""
    (folder / "rgb").mkdir(parents=True)
    lines = ["# timestamp filename"]
    for number in range(frames):
        image = np.full((16, 20), number, dtype=np.uint8)
        cv2.imwrite(str(folder / "rgb" / f"{number:06d}.png"), image)
        lines.append(f"{number / analytic.FRAME_RATE_HZ:.6f} rgb/{number:06d}.png")
    (folder / "rgb.txt").write_text("\n".join(lines) + "\n")
    if ground_truth:
        write_tum(analytic.ground_truth(range(frames)), folder / "groundtruth.txt")
    return folder


@pytest.fixture
def room(tmp_path: Path) -> Path:
    return write_sequence(tmp_path / "room", ground_truth=True)


@pytest.fixture(autouse=True)
def _copied_tables(copied_tables: None) -> None:
    """Make no tables anew."""


@pytest.fixture
def database(tmp_path: Path) -> Database:
    return create_database(str(tmp_path / "study.db"))


def definition_of(room: Path, **sections: Any) -> dict[str, Any]:
    """Return the data of a small study; sections replace or extend the default ones."""
    data: dict[str, Any] = {
        "name": "small",
        "pipeline": {"name": "analytic"},
        "sequences": [{"name": "room", "path": str(room)}],
        "space": {"filter.max_error": {"low": 3e-4, "high": 0.1, "log": True, "points": 5}},
        "gtf": {"clean_runs": 2, "noisy_runs": 3, "noise_sigma": 5.0},
        "search": {"sampler": "tpe", "trials": 8},
    }
    for name, section in sections.items():
        data[name] = {**data[name], **section} if isinstance(data.get(name), dict) and name != "space" else section
    return data


Runner = Callable[..., InlineExecutor]


@pytest.fixture
def run_study(database: Database) -> Runner:
    """Create the study unless it exists, work on it to its end (or until ``stop``), and return the executor."""

    def run(data: dict[str, Any], **worker: Any) -> InlineExecutor:
        from gtf_tune.store import studies

        if data["name"] not in studies.names(database):
            create_study(database, checked_definition(data, "test"), Path.cwd())
        executor = InlineExecutor()
        StudyWorker(open_study(database, data["name"]), executor, **worker).work()
        return executor

    return run
