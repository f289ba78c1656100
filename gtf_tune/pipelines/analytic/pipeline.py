"""Compute trajectories by a formula: a pipeline without images, with a known best setting.

It is a double for real pipelines in tests, tutorials and measurements of overhead and search; never a result. A run of
50 frames takes half a millisecond. What it imitates was measured on GLOMAP: the response to noise is proportional to
the noise and to the true error; its size differs by a third between noisy instances, the same for all settings; clean
runs differ a little; one noisy run in many falls apart with all its frames; strict settings fall apart more often, and
then lose frames.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import ClassVar

import numpy as np
from scipy.spatial.transform import Rotation

from gtf_tune.errors import DefinitionError, RunError
from gtf_tune.pipelines.analytic.failures import FAILURES
from gtf_tune.pipelines.base import PipelineJob, PipelineOutput
from gtf_tune.pipelines.options import OptionSpec, OptionTable, OptionValue, Setting, read_settings
from gtf_tune.pipelines.run import digest
from gtf_tune.sequence import Frame, SequenceCamera
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.sequence.image_noise import GreyImage
from gtf_tune.trajectory import BoolArray, FloatArray, Trajectory

VERSION = "1"
FRAME_RATE_HZ = 30.0

_SPECS = (
    OptionSpec("filter.max_error", 0.01, "Largest error of an inlier; best at 0.002.", low=1e-6, high=1.0),
    OptionSpec("robust.scale", 1.0, "Error at which the robust kernel sets in; best at 0.3.", low=1e-4, high=1e3),
    OptionSpec("matching.max_ratio", 0.8, "Ratio of best to second best match; best at 0.72.", low=0.1, high=1.0),
    OptionSpec("tracks.min_length", 3, "Images that must see a point; best at 4.", low=2, high=20),
    OptionSpec("robust.kernel", "huber", "Robust kernel; best is cauchy.", choices=("trivial", "huber", "cauchy")),
    OptionSpec("refine.intrinsics", True, "Whether to refine intrinsics; best is false."),
)

OPTIMUM: Mapping[str, OptionValue] = MappingProxyType(
    {
        "filter.max_error": 0.002,
        "robust.scale": 0.3,
        "matching.max_ratio": 0.72,
        "tracks.min_length": 4,
        "robust.kernel": "cauchy",
        "refine.intrinsics": False,
    }
)
"""The setting with the smallest true error and the smallest response to noise."""

SETTINGS: Mapping[str, Setting] = MappingProxyType(
    {"failure": Setting("none", tuple(FAILURES)), "failure_rate": Setting("1"), "collapse_rate": Setting("0.02")}
)
"""A share ``failure_rate`` of all runs does what ``failure`` says; ``collapse_rate`` is that of noisy runs at best."""

_BEST_ERROR_M = 1e-3
_KERNEL_COST = MappingProxyType({"cauchy": 0.0, "huber": 0.1, "trivial": 0.5})
_INTRINSICS_COST = 0.15
_WORST_COST = 7.0
_SIGMA_UNIT = 5.0
_INSTANCE_SPREAD = 0.3
_SETTING_SPREAD = 0.1
_CLEAN_SHARE = 0.05
_ROTATION_RAD_PER_M = 0.1
_STRICT_MAX_ERROR = 3e-4
_STRICT_MAX_RATIO = 0.5
_LARGEST_LOSS = 0.8
_RADIUS_M = 2.0
_FRAMES_PER_ROUND = 200


@dataclass
class AnalyticPipeline:
    """Give the true trajectory plus errors that depend smoothly on the options."""

    name: str
    version: str
    settings: Mapping[str, str]
    takes_several_cameras: ClassVar[bool] = True

    @property
    def options(self) -> OptionTable:
        """Return six options of all types and very different scales."""
        return OptionTable(self.name, {spec.name: spec for spec in _SPECS})

    def run(self, job: PipelineJob) -> PipelineOutput:
        """Return the trajectory of the job's frames; ``seed`` is the run's own, noise comes from ``job.images``.

        Raises
        ------
        RunError
            No frame is left, or the settings say so.
        """
        options = {spec.name: spec.default for spec in _SPECS} | dict(job.options)
        generator = np.random.default_rng([job.seed, job.images.seed, _bits(options)])
        if generator.random() < float(self.settings["failure_rate"]):
            FAILURES[self.settings["failure"]]()
        truth = _truth_of(job.images.sequence.frames)
        errors = self._position_errors(job, options, generator, len(truth))
        kept = generator.random(len(truth)) >= self.missing_share(options)
        if not kept.any():
            raise RunError("the analytic pipeline registered no frame; allow larger errors")
        return PipelineOutput(_moved(truth, errors, generator, kept), {"num_registered": int(kept.sum())})

    def expected_error(self, options: Mapping[str, OptionValue]) -> float:
        """Return the RMS position error in metres that options lead to."""
        return expected_error(options)

    def missing_share(self, options: Mapping[str, OptionValue]) -> float:
        """Return the expected share of frames without a pose."""
        return missing_share(options)

    def _position_errors(
        self, job: PipelineJob, options: Mapping[str, OptionValue], generator: np.random.Generator, frames: int
    ) -> FloatArray:
        """Return the errors (n, 3) in metres of one run."""
        error_m = self.expected_error(options)
        of_sequence = np.random.default_rng(frames)
        errors: FloatArray = error_m * of_sequence.standard_normal((frames, 3)) / math.sqrt(3)
        errors += _CLEAN_SHARE * error_m * generator.standard_normal((frames, 3))
        if not job.images.sigma:
            return errors
        # Common to all settings that see this noise, so that trials can be compared instance by instance.
        of_instance = np.random.default_rng([1, job.images.seed])
        size = math.exp(_INSTANCE_SPREAD * of_instance.standard_normal())
        size *= math.exp(_SETTING_SPREAD * generator.standard_normal()) * job.images.sigma / _SIGMA_UNIT
        errors += size * error_m * of_instance.standard_normal((frames, 3)) / math.sqrt(3)
        if of_instance.random() < self._collapse_rate(options):
            errors[frames // 2 :] += of_instance.standard_normal(3) * _RADIUS_M
        return errors

    def _collapse_rate(self, options: Mapping[str, OptionValue]) -> float:
        """Return the share of noisy runs that fall apart; it doubles with each threefold tightening of the filter."""
        decades = max(0.0, math.log10(_number(OPTIMUM, "filter.max_error") / _number(options, "filter.max_error")))
        return min(1.0, float(self.settings["collapse_rate"]) * math.pow(4.0, decades))


def create(settings: Mapping[str, object]) -> AnalyticPipeline:
    """Return the pipeline ``analytic``.

    Raises
    ------
    DefinitionError
        A setting is unknown or wrong.
    """
    values = read_settings("analytic", SETTINGS, settings)
    for name in ("failure_rate", "collapse_rate"):
        if not _is_share(values[name]):
            raise DefinitionError(f"pipeline 'analytic': setting '{name}' must lie in [0, 1], not {values[name]!r}")
    return AnalyticPipeline("analytic", VERSION, values)


def expected_error(options: Mapping[str, OptionValue]) -> float:
    """Return the RMS position error in metres that options lead to; absent options have their defaults."""
    full = {spec.name: spec.default for spec in _SPECS} | dict(options)
    filtering = math.log10(_number(full, "filter.max_error") / _number(OPTIMUM, "filter.max_error"))
    scale = math.log10(_number(full, "robust.scale") / _number(OPTIMUM, "robust.scale"))
    ratio = (_number(full, "matching.max_ratio") - _number(OPTIMUM, "matching.max_ratio")) / 0.1
    length = _number(full, "tracks.min_length") - _number(OPTIMUM, "tracks.min_length")
    # The mixed term ties two options together: sweeping them one by one does not find the optimum.
    cost = 0.5 * filtering**2 + 0.3 * scale**2 + 0.3 * filtering * scale + 0.1 * ratio**2 + 0.02 * length**2
    cost += _KERNEL_COST[str(full["robust.kernel"])] + (_INTRINSICS_COST if full["refine.intrinsics"] else 0.0)
    return float(_BEST_ERROR_M * math.exp(min(cost, _WORST_COST)))


def missing_share(options: Mapping[str, OptionValue]) -> float:
    """Return the expected share of frames without a pose; none unless options are very strict."""
    full = {spec.name: spec.default for spec in _SPECS} | dict(options)
    too_strict = max(0.0, math.log10(_STRICT_MAX_ERROR / _number(full, "filter.max_error")))
    too_strict += max(0.0, (_STRICT_MAX_RATIO - _number(full, "matching.max_ratio")) / 0.2)
    return _LARGEST_LOSS * (1.0 - math.exp(-2.0 * too_strict))


def ground_truth(frame_ids: Sequence[int]) -> Trajectory:
    """Return the exact poses of frames: a hand-held walk round a scene, in metres, looking at its middle."""
    times = tuple(frame_id / FRAME_RATE_HZ for frame_id in frame_ids)
    return _truth_of([Frame(frame_id, Path(), time) for frame_id, time in zip(frame_ids, times, strict=True)])


def imaginary_sequence(num_frames: int = 50) -> ImageSequence:
    """Return a sequence of black images that exist on no disk, with the ground truth of the analytic pipeline."""
    frames = tuple(Frame(index, Path(f"{index:06d}.pgm"), index / FRAME_RATE_HZ) for index in range(num_frames))
    return _ImaginarySequence(
        name="imaginary",
        root=Path(),
        layout="analytic",
        frames=frames,
        cameras=(SequenceCamera(64, 48, stored_size=(64, 48)),),
        ground_truth=ground_truth(range(num_frames)),
    )


class _ImaginarySequence(ImageSequence):
    def read_grey(self, frame: Frame) -> GreyImage:
        del frame
        return np.zeros((self.height, self.width), dtype=np.uint8)

    @cached_property
    def fingerprint(self) -> str:
        return digest(["imaginary", VERSION, len(self)])


def _truth_of(frames: Sequence[Frame]) -> Trajectory:
    ids = np.array([frame.frame_id for frame in frames], dtype=np.int64)
    angle = 2.0 * np.pi * ids / _FRAMES_PER_ROUND
    steps = np.stack([np.sin(7.0 * angle), np.sin(5.0 * angle + 1.0), np.cos(11.0 * angle)], axis=1)
    circle = np.stack([np.cos(angle), 0.2 * np.sin(2.0 * angle), np.sin(angle)], axis=1)
    positions = _RADIUS_M * circle + 0.03 * steps
    return Trajectory(
        frame_ids=ids,
        timestamps=np.array([frame.timestamp for frame in frames]),
        positions=positions,
        quaternions=_looking_at_origin(positions).as_quat(),
    )


def _looking_at_origin(positions: FloatArray) -> Rotation:
    """Return rotations world_from_camera with z ahead and y down (OpenCV axes) for cameras at (n, 3)."""
    ahead = -positions / np.linalg.norm(positions, axis=1, keepdims=True)
    right = np.cross(np.array([0.0, 1.0, 0.0]), ahead)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    return Rotation.from_matrix(np.stack([right, np.cross(ahead, right), ahead], axis=2))


def _moved(truth: Trajectory, errors: FloatArray, generator: np.random.Generator, kept: BoolArray) -> Trajectory:
    size = _ROTATION_RAD_PER_M * np.linalg.norm(errors, axis=1, keepdims=True)
    turns = Rotation.from_rotvec(size * generator.standard_normal(errors.shape))
    return Trajectory(
        frame_ids=truth.frame_ids[kept],
        timestamps=truth.timestamps[kept],
        positions=(truth.positions + errors)[kept],
        quaternions=(turns * truth.rotations).as_quat()[kept],
    )


def _number(options: Mapping[str, OptionValue], name: str) -> float:
    return float(options[name])


def _bits(options: Mapping[str, OptionValue]) -> int:
    return int(digest(dict(options))[:16], 16)


def _is_share(text: str) -> bool:
    try:
        return 0.0 <= float(text) <= 1.0
    except ValueError:
        return False
