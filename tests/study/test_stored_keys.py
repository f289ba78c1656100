"""Keys of runs and stages are stored; those of commit a5c3ed4 must stay, or its results would be computed anew."""

import dataclasses
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pycolmap
import pytest

from gtf_tune.definition import GtfDefinition
from gtf_tune.execution.base import RunLimits
from gtf_tune.pipelines import Pipeline, PipelineJob, create_pipeline
from gtf_tune.pipelines.analytic import imaginary_sequence
from gtf_tune.pipelines.colmap.stages import StagedRun
from gtf_tune.pipelines.run import RunKind, RunRequest
from gtf_tune.sequence import Camera, ImageSource
from gtf_tune.study.runs.plan import RunPlanner, SeedSource
from gtf_tune.study.runs.run_source import failed_key

INTRINSICS = Camera("PINHOLE", 64, 48, (50.0, 51.0, 32.0, 24.0))
VERSION = "9.9"  # not the installed one: keys must not depend on where the test runs


def request(
    pipeline: Pipeline,
    kind: RunKind = "noisy",
    *,
    camera: Camera | None = None,
    options: Mapping[str, Any] | None = None,
    fixed: Mapping[str, Any] | None = None,
    common_noise: bool = True,
) -> RunRequest:
    """Return run 1 of trial 4 of a study with seed 7."""
    pipeline.version = VERSION
    planner = RunPlanner(pipeline, GtfDefinition(common_noise=common_noise), SeedSource(7), fixed or {})
    sequence = imaginary_sequence(5).with_camera(camera)
    return planner.request(sequence, options or {}, (kind, 1), sigma=2.5, number=4)


def analytic() -> Pipeline:
    return create_pipeline("analytic", {"collapse_rate": 0.1})


def own_program() -> Pipeline:
    words = "sh -c true {images} {timestamps} {output} {options}"
    options = {"step": {"default": 1.0, "low": 0.0}, "label": {"default": "a", "choices": ["a", "b"]}}
    return create_pipeline("command", {"arguments": words.split(), "options": options})


def preset(folder: Path) -> Pipeline:
    program = folder / "colmap"
    program.write_text("#!/bin/sh\necho 'COLMAP 9.9 (Commit x)'\n")
    program.chmod(0o755)
    return create_pipeline("command", {"preset": "colmap-3.8", "colmap": str(program)})


def droid_slam(folder: Path) -> Pipeline:
    (folder / "droid_slam").mkdir()
    (folder / "droid_slam" / "droid.py").write_text("")
    (folder / "droid.pth").write_bytes(b"weights")
    return create_pipeline("droid-slam", {"checkout": str(folder), "python": sys.executable})


def failed(run: RunRequest) -> str:
    return failed_key(run, RunLimits(60.0, 2**30))


RUNS: Mapping[str, tuple[Callable[[Path], str], str]] = {
    "analytic, noisy": (
        lambda folder: request(analytic()).key,
        "470118b41809d37884b88756be1c70b34a02c19aa8670dae12b0d674d88951aa",
    ),
    "analytic, clean, with options": (
        lambda folder: (
            request(analytic(), "clean", options={"filter.max_error": 0.002}, fixed={"robust.kernel": "cauchy"}).key
        ),
        "ba9b753acb31d43f0d7d8f3d6e9faac31e9cb268cb1d006884d5715d50e3bb24",
    ),
    "analytic, noise of its own for every trial": (
        lambda folder: request(analytic(), common_noise=False).key,
        "34f3432341eaeb2c89e9a054d710b513402e715f94f336d9fb43f0a14d6c551f",
    ),
    "analytic, failed": (
        lambda folder: failed(request(analytic(), "clean")),
        "7b7ed24ca4767fd0096349e9577dd7231d95305ced9ff30b15f907f3e4ea6c99",
    ),
    "glomap, noisy, with intrinsics": (
        lambda folder: request(create_pipeline("glomap"), camera=INTRINSICS).key,
        "8f589d64e397b8e93178fdf400cd9f388243cb219921e212d08ad1e77fa52b1c",
    ),
    "glomap, clean, without intrinsics": (
        lambda folder: (
            request(
                create_pipeline("glomap", {"camera_model": "OPENCV"}), "clean", options={"mapper.ba_num_iterations": 2}
            ).key
        ),
        "bff357de962069b1f6fb95026e27343692e280790ada2d07029df762cdce54a2",
    ),
    "colmap, noisy, sequential": (
        lambda folder: (
            request(create_pipeline("colmap", {"pairing": "sequential"}), options={"sequential.overlap": 5}).key
        ),
        "0a36d7962412dafba3c3d04ad080ec1c8fe831ed44975de2c5823c7fd56d3ba0",
    ),
    "command, a program that is given times": (
        lambda folder: request(own_program(), options={"step": 2.0}).key,
        "7681e956827279a9f366a9519feea44ffe1cf1e6b156a1bac3c29a39667637c2",
    ),
    "command, a preset": (
        lambda folder: request(preset(folder), "clean", camera=INTRINSICS, options={"SiftMatching.max_error": 2.0}).key,
        "43b9bce390b736a054ea8b6097d6efab747a106776456d34a355c7455eec07f2",
    ),
    "droid-slam": (
        lambda folder: request(droid_slam(folder), camera=INTRINSICS, options={"beta": 0.4}).key,
        "639320961297f6f26aee1d971929063eaafaa8ba304af72b2b6b380239f20a8b",
    ),
}

STAGES = {
    "features": "f41b1297713c6f5e1d6f59d1f4151bb8f9e4ded308a2762e3e42788d585550be",
    "matches": "46af1e5ecf8130c1f8d4fb503ddcdad5019108cd2f89655281c3ebe7ebbbb5ad",
    "geometry": "89afb0c7ec8b5d2438c117df34636c6e849060c55e413a9a465fe1588c96f99b",
    "calibration": "e484c512760916707e7eefb1281c3a58d2825ad5b82c300a7ed770959931bf86",
    "positioning": "55416e194864dce63e2f135018ab88273a5671c61e584d20b46b89df9b8dcdb0",
    "positioning, with intrinsics": "718fb7e4e9570abd0034d52d4ce569af8d0740eadbced20bcc278fe6f5c21261",
}


@pytest.mark.parametrize("name", RUNS)
def test_runs_keep_their_keys(name: str, tmp_path: Path) -> None:
    key, expected = RUNS[name]

    assert key(tmp_path) == expected


@pytest.mark.skipif(pycolmap.__version__ != "4.2.1", reason="keys of stages hold all options of pycolmap 4.2.1")
def test_stages_keep_their_keys() -> None:
    assert stage_keys() == STAGES


class _Reached(Exception):
    """Signal that the key of a stage is known, so that nothing is built."""


@dataclasses.dataclass
class _Stages:
    keys: dict[str, str]

    def reach(self, stage: str, key: str, build: Callable[[Path], None]) -> Path:
        del build
        self.keys[stage] = key
        if stage == "positioning":
            raise _Reached
        return Path("nowhere")


def stage_keys() -> dict[str, str]:
    """Return the keys of the stages of one noisy glomap run, without and with intrinsics."""
    without = _keys_of(None)
    return {**without, "positioning, with intrinsics": _keys_of(INTRINSICS)["positioning"]}


def _keys_of(camera: Camera | None) -> dict[str, str]:
    pipeline: Any = create_pipeline("glomap")
    images = ImageSource(imaginary_sequence(5).with_camera(camera), sigma=2.5, seed=11)
    options = pipeline.options.check({"extraction.sift.peak_threshold": 0.01})
    stages = _Stages({})
    job = PipelineJob(images, options, seed=3, threads=1, workspace=Path("nowhere"), stages=stages)
    built = pipeline._tree.build(options, threads=1, seed=3)
    staged = StagedRun(job, built, pipeline.settings, VERSION)
    with pytest.raises(_Reached):
        pipeline.map(staged)
    found = {stage: getattr(staged, f"{stage}_key") for stage in ("features", "matches", "geometry", "calibration")}
    return {**found, "positioning": stages.keys["positioning"]}
