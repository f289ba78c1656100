"""Run DROID-SLAM (https://github.com/princeton-vl/DROID-SLAM) by a driver in its own Python."""

import json
import shutil
import subprocess
import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from gtf_tune.errors import DefinitionError, RunError
from gtf_tune.pipelines.base import DiagnosticValue, PipelineJob, PipelineOutput
from gtf_tune.pipelines.command.camera import DISTORTION, opencv_camera
from gtf_tune.pipelines.command.cuda_lock import cuda_device, cuda_lock
from gtf_tune.pipelines.command.definition import OutputDefinition
from gtf_tune.pipelines.command.output import read_output
from gtf_tune.pipelines.command.process import ProgramExit, check_exit, run_program
from gtf_tune.pipelines.droid_slam.options import OPTIONS
from gtf_tune.pipelines.file_digest import file_digest
from gtf_tune.pipelines.options import OptionTable, Setting, read_settings
from gtf_tune.pipelines.run import digest

SETTINGS: Mapping[str, Setting] = {"checkout": Setting(""), "python": Setting(""), "weights": Setting("")}
"""``checkout`` is DROID-SLAM's folder; ``python`` what it is installed in (by default ``.venv/bin/python`` there),
``weights`` its network (by default ``droid.pth`` there)."""

_DRIVER = Path(__file__).with_name("driver.py")
_POSES = OutputDefinition(path="poses.txt", format="tum", association="index")
_ASK_TORCH = "from importlib.metadata import version; print(version('torch'))"
_ASK_TIMEOUT_S = 60
_SHORT_DIGEST = 12


@dataclass
class DroidSlamPipeline:
    """Track grey images as three equal channels, and fill in the poses of all frames that are no keyframes."""

    name: str
    version: str
    settings: Mapping[str, str]
    checkout: Path
    python: Path
    weights: Path

    @property
    def options(self) -> OptionTable:
        """Return the options of DROID-SLAM's demo."""
        return OptionTable(self.name, OPTIONS)

    def run(self, job: PipelineJob) -> PipelineOutput:
        """Return a pose for every frame.

        Waits until no other run of this user has the CUDA device.

        Raises
        ------
        RunError
            The intrinsics are unknown or not OpenCV's, or DROID-SLAM failed.
        """
        images = job.stages.reach("images", job.images.key, job.images.write)
        outcome_path = job.workspace / "outcome.json"
        (job.workspace / "job.json").write_text(json.dumps(self._job(job, images, outcome_path)), encoding="utf-8")
        waiting_since = time.perf_counter()
        with cuda_lock(cuda_device(), job.waiting) as lock:
            waited_s = time.perf_counter() - waiting_since
            ended = run_program(
                [str(self.python), str(_DRIVER), str(job.workspace / "job.json")],
                job.workspace,
                {},
                job.workspace / "report.json",
                [lock],
            )
        diagnostics = _read_outcome(outcome_path, ended)
        trajectory, _ = read_output(_POSES, job.workspace / _POSES.path, job.images.names, job)
        return PipelineOutput(trajectory, {**diagnostics, "gpu_wait_s": round(waited_s, 4)})

    def _job(self, job: PipelineJob, images: Path, outcome: Path) -> dict[str, object]:
        camera = opencv_camera(job.camera) if job.camera else {}
        if not camera:
            known = f"of the model {job.camera.model}" if job.camera else "unknown"
            raise RunError(
                f"DROID-SLAM needs intrinsics of a pinhole camera with OpenCV's distortion, but they are {known}; "
                "give the camera of the sequence"
            )
        distorted = bool(camera["distortion"])
        return {
            "checkout": str(self.checkout),
            "weights": str(self.weights),
            "images": [str(images / name) for name in job.images.names],
            "intrinsics": [camera[name] for name in ("fx", "fy", "cx", "cy")],
            "distortion": [camera[name] for name in DISTORTION] if distorted else [],
            "options": {name: spec.default for name, spec in OPTIONS.items()} | dict(job.options),
            "seed": job.seed,
            "poses": str(job.workspace / _POSES.path),
            "outcome": str(outcome),
        }


def create(settings: Mapping[str, object]) -> DroidSlamPipeline:
    """Return the pipeline ``droid-slam`` for a checkout, its Python and its weights.

    Raises
    ------
    DefinitionError
        A setting is unknown or missing, or names something that is not there.
    """
    given = read_settings("droid-slam", SETTINGS, settings)
    if not given["checkout"]:
        raise DefinitionError(
            "pipeline 'droid-slam' needs the setting 'checkout', the folder of DROID-SLAM; see docs/droid-slam.md"
        )
    checkout = Path(given["checkout"]).expanduser().absolute()
    python = _found_python(given["python"] or str(checkout / ".venv" / "bin" / "python"))
    weights = Path(given["weights"] or checkout / "droid.pth").expanduser().absolute()
    faults = []
    if not (checkout / "droid_slam" / "droid.py").is_file():
        faults.append(f"there is no DROID-SLAM at {checkout} (no droid_slam/droid.py); clone it and set 'checkout'")
    if python is None:
        faults.append(f"there is no Python at '{given['python'] or checkout / '.venv'}'; set 'python'")
    if not weights.is_file():
        faults.append(f"there are no weights at {weights}; download droid.pth as its README says and set 'weights'")
    if faults or python is None:
        raise DefinitionError("pipeline 'droid-slam': " + "; ".join(faults))
    return DroidSlamPipeline(
        name="droid-slam",
        version=f"sources {_source_digest(checkout)}, torch {_torch_version(python)}",
        settings={"weights": file_digest(weights), "driver": file_digest(_DRIVER)},
        checkout=checkout,
        python=python,
        weights=weights,
    )


def _found_python(value: str) -> Path | None:
    found = shutil.which(str(Path(value).expanduser()))
    # The path is kept as it is: a virtual environment's Python is a link that must not be followed.
    return Path(found).absolute() if found else None


def _source_digest(checkout: Path) -> str:
    sources = sorted([*(checkout / "droid_slam").rglob("*.py"), *(checkout / "src").glob("*.c*")])
    return digest({str(path.relative_to(checkout)): file_digest(path) for path in sources})[:_SHORT_DIGEST]


@cache
def _torch_version(python: Path) -> str:
    try:
        asked = subprocess.run(
            [python, "-c", _ASK_TORCH], capture_output=True, text=True, timeout=_ASK_TIMEOUT_S, check=False
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DefinitionError(f"pipeline 'droid-slam': {python} cannot be run ({error}); set 'python'") from error
    return asked.stdout.strip() or "unknown"


def _read_outcome(path: Path, ended: ProgramExit) -> dict[str, DiagnosticValue]:
    try:
        outcome: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        check_exit("DROID-SLAM", ended)
        raise RunError("DROID-SLAM ended without an outcome; see the log of the run") from None
    if "error" in outcome:
        raise RunError(outcome["error"])
    check_exit("DROID-SLAM", ended)
    return outcome
