"""Stand a newcomer's folder up: photos, a video, and a command line whose reconstructions take no time."""

import contextlib
import importlib
import shutil
import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Any

import cv2
import numpy as np
import pytest

import gtf_tune.api.executor
import gtf_tune.execution
import gtf_tune.sequence
import gtf_tune.study.tune.estimate
import gtf_tune.study.tune.handover
import gtf_tune.study.tune.start
from gtf_tune.cli.main import main
from gtf_tune.execution import InlineExecutor
from gtf_tune.pipelines import analytic, registry
from gtf_tune.trajectory import write_tum
from tests.docs.pages import ROOT
from tests.study.conftest import write_sequence

Command = Callable[[list[str]], int]


@pytest.fixture(scope="session")
def generate() -> ModuleType:
    """The generator of the reference pages, imported as the script finds its neighbours."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(ROOT / "docs"))
        return importlib.import_module("generate")


@pytest.fixture
def call() -> Iterator[Command]:
    """Call gtf-tune in this process with quick reconstructions and return its exit code."""
    with quick_command_line() as command:
        yield command


@contextlib.contextmanager
def quick_command_line() -> Iterator[Command]:
    """Give a command line whose reconstructions and renderings take no time."""
    built_in = {**registry._BUILT_IN, "glomap": "tests.docs.quick_glomap:create"}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(registry, "_BUILT_IN", MappingProxyType(built_in))
        patch.setattr(gtf_tune.execution, "LocalExecutor", _inline)
        patch.setattr(gtf_tune.api.executor, "LocalExecutor", _inline)
        patch.setattr(gtf_tune.sequence, "render_room", _tiny_room)
        for module in (gtf_tune.study.tune.handover, gtf_tune.study.tune.estimate):
            patch.setattr(module, "makes_models", lambda _: False)
        patch.setattr(gtf_tune.study.tune.start, "MOST_TRIALS", 9)
        yield partial(_call, patch)


@pytest.fixture(scope="session")
def material(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with photos, a second walk, a video, and trajectories of clean and of noisy images."""
    folder = tmp_path_factory.mktemp("material")
    for name, frames in {"photos": 12, "second-walk": 11}.items():
        shutil.move(write_sequence(folder / "full", ground_truth=False, frames=frames) / "rgb", folder / name)
        shutil.rmtree(folder / "full")
    _write_video(folder / "walk.mp4")
    for kind, count, spread in (("clean", 2, 1e-4), ("noisy", 6, 1e-3)):
        _write_trajectories(folder / kind, count, spread)
    return folder


@pytest.fixture(scope="session")
def finished(material: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the same and a finished study of the photos."""
    folder = tmp_path_factory.mktemp("finished") / "folder"
    shutil.copytree(material, folder)
    with contextlib.chdir(folder), quick_command_line() as call:
        space = "mapper.max_normalized_reproj_error=1e-4:1e-1:log"
        assert call(["study", "create", "photos", "-s", "photos", "-r", space, "-n", "9"]) == 0
        assert call(["study", "run", "photos"]) == 0
    return folder


def _call(patch: pytest.MonkeyPatch, arguments: list[str]) -> int:
    patch.setattr(sys, "argv", ["gtf-tune", *arguments])
    try:
        main()
    except SystemExit as exit_:
        return int(exit_.code or 0)
    return 0


def _inline(jobs: int, stages: Any = None, **_: Any) -> InlineExecutor:
    del jobs, stages
    return InlineExecutor()


def _tiny_room(folder: Path, spec: object = None) -> None:
    del spec
    write_sequence(folder, ground_truth=True)


def _write_trajectories(folder: Path, count: int, spread: float) -> None:
    folder.mkdir()
    truth = analytic.ground_truth(range(20))
    for index in range(count):
        shaken = np.random.default_rng([count, index]).normal(scale=spread, size=(20, 3))
        write_tum(replace(truth, positions=truth.positions + shaken), folder / f"run{index}.txt")


def _write_video(path: Path) -> None:
    size = (64, 48)
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 10.0, size)
    generator = np.random.default_rng(0)
    for _ in range(40):
        writer.write(generator.integers(0, 255, (size[1], size[0], 3), dtype=np.uint8))
    writer.release()
