"""The device of the pycolmap pipelines: what is stored, which keys change, and who waits for whom."""

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pycolmap
import pytest

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.colmap import stages
from gtf_tune.pipelines.colmap.stages import StagedRun
from gtf_tune.store import studies
from gtf_tune.store.database import Database
from gtf_tune.store.studies import stored_definition
from gtf_tune.study.create import checked_definition, create_study


@pytest.fixture
def with_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pycolmap, "has_cuda", True)


@pytest.fixture
def without_cuda(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pycolmap, "has_cuda", False)


@pytest.mark.parametrize("given", [{}, {"device": "cpu"}, {"device": "auto"}])
def test_the_settings_of_a_run_on_the_cpu_are_those_without_a_device(given: dict[str, str], without_cuda: None) -> None:
    assert create_pipeline("glomap", given).settings == create_pipeline("glomap").settings
    assert "device" not in create_pipeline("glomap", given).settings


@pytest.mark.parametrize("given", ["cuda", "auto"])
def test_a_gpu_is_part_of_what_runs_depend_on(given: str, with_cuda: None) -> None:
    assert create_pipeline("glomap", {"device": given}).settings["device"] == "cuda"


def test_a_gpu_that_pycolmap_cannot_use_is_refused(without_cuda: None) -> None:
    with pytest.raises(DefinitionError, match="built without CUDA; install the package 'pycolmap-cuda12'"):
        create_pipeline("colmap", {"device": "cuda"})


@pytest.mark.parametrize("has_cuda", [True, False])
def test_a_study_keeps_the_device_that_auto_was_when_it_was_created(
    has_cuda: bool, room: Path, database: Database, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pycolmap, "has_cuda", has_cuda)
    data = {
        "name": "small",
        "pipeline": {"name": "glomap", "settings": {"device": "auto"}},
        "sequences": [{"name": "room", "path": str(room)}],
        "space": {"mapper.min_tri_angle_deg": {"values": [1.0, 2.0]}},
    }

    create_study(database, checked_definition(data, "small"), room.parent)

    stored = stored_definition(studies.get(database, "small"))
    assert stored.pipeline.settings["device"] == ("cuda" if has_cuda else "cpu")


@dataclass
class _Job:
    threads: int = 1
    waiting = staticmethod(contextlib.nullcontext)


def test_a_gpu_changes_the_keys_of_stages_and_serves_one_run_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    held: list[str] = []

    @contextlib.contextmanager
    def lock(device: str, waiting: object) -> Iterator[int]:
        held.append(device)
        yield 0

    monkeypatch.setattr(stages, "cuda_lock", lock)
    on_cpu, on_gpu = (StagedRun(_Job(), None, settings, "1") for settings in ({}, {"device": "cuda"}))

    with on_cpu._device() as device:
        assert (device, held) == (pycolmap.Device.cpu, [])
    with on_gpu._device() as device:
        assert (device, held) == (pycolmap.Device.cuda, ["0"])
    assert on_cpu.key("features") != on_gpu.key("features")
