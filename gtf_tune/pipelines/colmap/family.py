"""Run pycolmap's mappers on the stages that they share."""

import math
import struct
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import pycolmap

from gtf_tune.errors import DefinitionError, OptionError, RunError, TrajectoryError
from gtf_tune.pipelines.base import DiagnosticValue, PipelineJob, PipelineOutput
from gtf_tune.pipelines.colmap.options import OptionRoot, OptionTree, read_tree
from gtf_tune.pipelines.colmap.stages import PAIRINGS, StagedRun, shared_roots, stage_errors
from gtf_tune.pipelines.file_digest import file_digest
from gtf_tune.pipelines.options import OptionTable, OptionValue, Setting, read_settings
from gtf_tune.sequence import ImageSource, Sequence
from gtf_tune.trajectory import Trajectory

SETTINGS: Mapping[str, Setting] = {
    "pairing": Setting("exhaustive", tuple(PAIRINGS)),
    "camera_model": Setting("SIMPLE_RADIAL", tuple(sorted(set(pycolmap.CameraModelId.__members__) - {"INVALID"}))),
    "vocab_tree_path": Setting(""),
    "device": Setting("cpu", ("cpu", "cuda", "auto")),
}
"""``camera_model`` is used where intrinsics are unknown; ``vocab_tree_path`` by ``sequential.loop_detection``.

``device`` extracts and matches features: ``auto`` is CUDA where pycolmap was built with it. Pipelines have none where
it is the CPU, so that their keys are those of versions that knew no other.
"""

# The first number of a tree is its format; before faiss took the place of flann it was the number of visual words.
_TREE_HEAD = struct.Struct("<iii")
_TREE_VERSIONS = (1, 2)
_SHARED_STAGES = ("images", "features", "matches", "geometry")


@dataclass
class PycolmapPipeline(ABC):
    """Run COLMAP's shared stages and then one of its mappers; results do not depend on what the cache holds."""

    name: str
    version: str
    settings: Mapping[str, str]

    roots: ClassVar[Mapping[str, OptionRoot]]
    takes_several_cameras: ClassVar[bool] = True

    @property
    def options(self) -> OptionTable:
        """Return the whole option tree of the pycolmap classes that the pipeline uses."""
        return self._tree.table(self.name, self._check_more)

    def run(self, job: PipelineJob) -> PipelineOutput:
        """Return the largest model that the mapper finds.

        Raises
        ------
        RunError
            A stage failed, or there is no model.
        """
        options = self._tree.build(job.options, threads=job.threads, seed=job.seed)
        staged = StagedRun(job, options, self.settings, self.version)
        with stage_errors("mapping"), staged.clock.timing("mapping"):
            models = self.map(staged)
        if not models:
            raise RunError(_no_model_reason(staged))
        model = max(models, key=lambda found: found.num_reg_images())
        timing = staged.clock.diagnostics((*_SHARED_STAGES, *self.own_stages(job)), always_run=("mapping",))
        return PipelineOutput(trajectory_of(model, job.images), {**_describe(model, len(models)), **timing})

    def focal_prior(self, sequence: Sequence) -> float | None:
        """Return the focal length in pixels that COLMAP reads from the EXIF of the first image, or ``None``.

        COLMAP starts from it, calibrates pairs of images with it, and refines it.
        """
        bitmap = pycolmap.Bitmap.read(sequence.frames[0].path, False)
        focal = bitmap.exif_focal_length() if bitmap is not None else None
        if focal is None or not (math.isfinite(focal) and focal > 0):
            return None
        return float(focal) * sequence.width / sequence.stored_size[0]

    def own_stages(self, job: PipelineJob) -> tuple[str, ...]:
        """Return the cached stages of a job between two-view geometry and mapping."""
        del job
        return ()

    @abstractmethod
    def map(self, staged: StagedRun) -> list[Any]:
        """Return the models (`pycolmap.Reconstruction`) of a staged run; none where mapping failed."""

    @property
    def _tree(self) -> OptionTree:
        return _tree(type(self), self.settings["pairing"])

    def _check_more(self, values: Mapping[str, OptionValue]) -> None:
        if values.get("sequential.loop_detection") is True and not self.settings["vocab_tree_path"]:
            raise OptionError(
                "option 'sequential.loop_detection' needs a vocabulary tree file; "
                f"give its path as setting 'vocab_tree_path' of pipeline '{self.name}'"
            )


def settings_of(pipeline: str, given: Mapping[str, object]) -> dict[str, str]:
    """Return the checked settings of a pycolmap pipeline, and with a vocabulary tree the digest of its contents.

    Raises
    ------
    DefinitionError
        A setting is unknown or wrong, the vocabulary tree is not there, or pycolmap was built without CUDA.
    """
    settings = _with_device(pipeline, read_settings(pipeline, SETTINGS, given))
    tree = settings["vocab_tree_path"]
    if tree and not Path(tree).is_file():
        raise DefinitionError(f"pipeline '{pipeline}': no vocabulary tree file at '{tree}'; nothing is downloaded")
    if tree and not _is_vocab_tree(Path(tree)):
        raise DefinitionError(
            f"pipeline '{pipeline}': '{tree}' is no vocabulary tree of COLMAP 4, whose format is not that of versions "
            "before 3.12; build one with 'colmap vocab_tree_builder' of COLMAP 4"
        )
    return {**settings, "vocab_tree": file_digest(Path(tree))} if tree else settings


def _with_device(pipeline: str, settings: dict[str, str]) -> dict[str, str]:
    """Return the settings with the device that ``auto`` stands for on this machine, without the CPU."""
    device = settings.pop("device")
    if device == "cuda" and not pycolmap.has_cuda:
        raise DefinitionError(
            f"pipeline '{pipeline}': this pycolmap was built without CUDA; install the package 'pycolmap-cuda12' in "
            "its place, or leave out device = 'cuda'"
        )
    return {**settings, "device": "cuda"} if device != "cpu" and pycolmap.has_cuda else settings


def _is_vocab_tree(path: Path) -> bool:
    """Return whether a file begins like a vocabulary tree of COLMAP 4: at any other, pycolmap aborts the process."""
    try:
        with path.open("rb") as file:
            head = file.read(_TREE_HEAD.size)
    except OSError as error:
        raise DefinitionError(
            f"the vocabulary tree '{path}' cannot be read ({error}); check its permissions"
        ) from error
    return len(head) == _TREE_HEAD.size and _TREE_HEAD.unpack(head)[0] in _TREE_VERSIONS


def pycolmap_version() -> str:
    """Return the version of the pycolmap that runs, which may be that of the package ``pycolmap-cuda12``."""
    return str(pycolmap.__version__)


def run_to_models(controller: Callable[[Any], Any]) -> list[Any]:
    """Return the models that ``controller(manager).run()`` leaves in its reconstruction manager."""
    manager = pycolmap.ReconstructionManager()
    controller(manager).run()
    return [manager.get(index) for index in range(manager.size())]


def trajectory_of(model: Any, images: ImageSource) -> Trajectory:
    """Return the camera poses of the registered images of a model, in the model's own frame and unit.

    Raises
    ------
    RunError
        A pose is not finite.
    """
    registered = {
        images.frame_id_of(model.images[image_id].name): model.images[image_id] for image_id in model.reg_image_ids()
    }
    frames = [frame for frame in images.sequence.frames if frame.frame_id in registered]
    poses = [registered[frame.frame_id].cam_from_world().inverse() for frame in frames]
    names = {images.frame_id_of(name): name for name in images.names}
    try:
        return Trajectory(
            frame_ids=np.array([frame.frame_id for frame in frames], dtype=np.int64),
            timestamps=np.array([frame.timestamp for frame in frames]),
            positions=np.array([pose.translation for pose in poses]),
            quaternions=np.array([pose.rotation.quat for pose in poses]),
            names=tuple(names[frame.frame_id] for frame in frames),
        )
    except TrajectoryError as error:
        raise RunError(f"the mapper's poses are unusable: {error}") from error


@cache
def _tree(pipeline: type[PycolmapPipeline], pairing: str) -> OptionTree:
    return read_tree({**shared_roots(pairing), **pipeline.roots})


def _describe(model: Any, num_models: int) -> dict[str, DiagnosticValue]:
    return {
        "num_models": num_models,
        "num_registered": int(model.num_reg_images()),
        "num_points3D": int(model.num_points3D()),
        "mean_reprojection_error_px": float(model.compute_mean_reprojection_error()),
        "mean_track_length": float(model.compute_mean_track_length()),
    }


def _no_model_reason(staged: StagedRun) -> str:
    with staged.opened(staged.geometry()) as database:
        images, keypoints = database.num_images(), database.num_keypoints()
        _, inliers = database.read_two_view_geometry_num_inliers()
    pairs = sum(count > 0 for count in inliers)
    return (
        f"the mapper found no model in {images} images with {keypoints} features, {pairs} verified pairs and "
        f"{sum(inliers)} inlier matches"
    )
