"""Reach the stages that COLMAP's mappers share: images, features, matches, two-view geometry, calibration.

Each stage has a key over its own options in force, the key of its input, the version, and seed and threads where they
matter. A stage whose files are at hand is not run, and neither are the stages before it.

=============  ====================================================  =============================================
stage          files                                                 depends on
=============  ====================================================  =============================================
images         grey images                                           the image source
features       database with images, cameras, keypoints, descr.      images, cameras, priors, ``extraction.*``
matches        database with matches only                            features, ``matching.*``, pairing
geometry       database with keypoints and verified pairs            matches, ``verification.*``, seed
calibration    the same, with focal lengths estimated                geometry, matches, ``view_graph.*``, seed
=============  ====================================================  =============================================
"""

import contextlib
import copy
import shutil
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import pycolmap

from gtf_tune.errors import RunError
from gtf_tune.pipelines.base import PipelineJob
from gtf_tune.pipelines.colmap.database import add_rows, copy_database, copy_rows, make_plain
from gtf_tune.pipelines.colmap.options import OptionObjects, OptionRoot
from gtf_tune.pipelines.command.cuda_lock import cuda_device, cuda_lock
from gtf_tune.pipelines.file_digest import file_digest
from gtf_tune.pipelines.options import OptionValue
from gtf_tune.pipelines.run import digest
from gtf_tune.pipelines.stage_clock import StageClock
from gtf_tune.sequence import SequenceCamera

DATABASE = "database.db"

# Guided matching and rigs act inside verification, so they must not spoil the key of the matches.
_VERIFIED_LATER = ("matching.guided_matching", "matching.rig_verification")

# Types other than SIFT are networks that pycolmap would download, or ends the process where it was built without them.
EXTRACTION = OptionRoot("FeatureExtractionOptions", "features", {(): "extraction"}, pinned=frozenset({"type"}))
MATCHING = OptionRoot(
    "FeatureMatchingOptions", "matches", {(): "matching"}, pinned=frozenset({"type", "skip_geometric_verification"})
)
PAIRINGS: Mapping[str, OptionRoot] = {
    "exhaustive": OptionRoot("ExhaustivePairingOptions", "matches", {(): "exhaustive"}),
    "sequential": OptionRoot("SequentialPairingOptions", "matches", {(): "sequential"}),
}
VERIFICATION = OptionRoot("TwoViewGeometryOptions", "geometry", {(): "verification"})
VIEW_GRAPH = OptionRoot("ViewGraphCalibrationOptions", "calibration", {(): "view_graph"})


def shared_roots(pairing: str) -> dict[str, OptionRoot]:
    """Return the option roots of the stages that every mapper needs."""
    return {
        "extraction": EXTRACTION,
        "matching": MATCHING,
        "pairing": PAIRINGS[pairing],
        "verification": VERIFICATION,
    }


@dataclass(frozen=True)
class StagedRun:
    """Reach the stages of one run, and remember how long each took."""

    job: PipelineJob
    options: OptionObjects
    settings: Mapping[str, str]
    version: str
    clock: StageClock = field(default_factory=StageClock)

    def key(self, stage: str, **parts: object) -> str:
        """Return the key of a stage from what it depends on besides version, number of threads, and device."""
        device = {"device": self.settings["device"]} if "device" in self.settings else {}
        return digest({"stage": stage, "version": self.version, "threads": self.job.threads, **device, **parts})

    @contextlib.contextmanager
    def _device(self) -> Iterator[pycolmap.Device]:
        """Yield the device that extracts and matches; a GPU serves one run at a time."""
        if self.settings.get("device") != "cuda":
            yield pycolmap.Device.cpu
            return
        with cuda_lock(cuda_device(), self.job.waiting):
            yield pycolmap.Device.cuda

    @property
    def intrinsics_known(self) -> bool:
        """Return whether the intrinsics of all cameras are known."""
        return all(camera.intrinsics for camera in self.job.images.sequence.cameras)

    @cached_property
    def features_key(self) -> str:
        """Return the key of features and descriptors."""
        sequence = self.job.images.sequence
        parts: dict[str, object] = {}
        if len(sequence.cameras) > 1:
            parts = {"camera": self.settings["camera_model"], "cameras": sequence.cameras_key}
        else:
            [camera] = sequence.cameras
            parts = {"camera": camera.key if camera.intrinsics else self.settings["camera_model"]}
            parts |= {} if camera.prior is None else {"focal_prior": camera.prior}
        return self.key(
            "features", images=self.job.images.key, options=dict(self.options.values["extraction"]), **parts
        )

    @cached_property
    def matches_key(self) -> str:
        """Return the key of the matches before verification."""
        tree = Path(self.settings["vocab_tree_path"])
        options = {name: one for name, one in self._matching.items() if name not in _VERIFIED_LATER}
        return self.key(
            "matches",
            features=self.features_key,
            options=options,
            pairing=dict(self.options.values["pairing"]),
            vocab_tree=file_digest(tree) if self._uses_vocab_tree else "",
        )

    @cached_property
    def geometry_key(self) -> str:
        """Return the key of the verified pairs."""
        return self.key(
            "geometry",
            matches=self.matches_key,
            options=dict(self.options.values["verification"]),
            guided={name: self._matching[name] for name in _VERIFIED_LATER},
            seed=self.job.seed,
        )

    @cached_property
    def calibration_key(self) -> str:
        """Return the key of the verified pairs with estimated focal lengths."""
        return self.key(
            "calibration",
            geometry=self.geometry_key,
            matches=self.matches_key,
            options=dict(self.options.values["view_graph"]),
            seed=self.job.seed,
        )

    def reach(self, stage: str, key: str, build: Callable[[Path], None]) -> Path:
        """Return the folder of a stage, timing what is built and naming the stage in its errors."""

        def build_timed(folder: Path) -> None:
            with self.clock.timing(stage), stage_errors(stage):
                build(folder)

        return self.job.stages.reach(stage, key, build_timed)

    def geometry(self) -> Path:
        """Return a database of verified pairs; it is read-only."""
        return self.reach("geometry", self.geometry_key, self._build_geometry) / DATABASE

    def calibration(self) -> Path:
        """Return a database of verified pairs with focal lengths from the view graph; it is read-only."""
        return self.reach("calibration", self.calibration_key, self._build_calibration) / DATABASE

    @contextlib.contextmanager
    def opened(self, database: Path) -> Iterator[Any]:
        """Open a private copy of a stage's database, because COLMAP writes beside every database that it opens."""
        with self._scratch() as working:
            shutil.copyfile(database, working)
            opened = pycolmap.Database.open(working)
            try:
                yield opened
            finally:
                opened.close()

    @property
    def _matching(self) -> Mapping[str, OptionValue]:
        return self.options.values["matching"]

    @property
    def _uses_vocab_tree(self) -> bool:
        return self.options.values["pairing"].get("sequential.loop_detection") is True

    def _features(self) -> Path:
        return self.reach("features", self.features_key, self._build_features) / DATABASE

    def _matches(self) -> Path:
        return self.reach("matches", self.matches_key, self._build_matches) / DATABASE

    def _build_features(self, folder: Path) -> None:
        sequence = self.job.images.sequence
        named = list(zip(sequence.taken_by, self.job.images.names, strict=True))
        with self._images() as images, self._device() as device:
            for number, camera in enumerate(sequence.cameras):  # a call makes one camera, and adds to the database
                pycolmap.extract_features(
                    folder / DATABASE,
                    images,
                    image_names=[name for taken_by, name in named if taken_by == number],
                    camera_mode=pycolmap.CameraMode.SINGLE,
                    reader_options=self._reader_options(camera),
                    extraction_options=self.options["extraction"],
                    device=device,
                )
        make_plain(folder / DATABASE)

    @contextlib.contextmanager
    def _images(self) -> Iterator[Path]:
        """Yield the folder of the images; those of a noisy copy, a third of the cache, exist for this step only."""
        images = self.job.images
        if not images.sigma:
            yield self.reach("images", images.key, images.write)
            return
        with tempfile.TemporaryDirectory(dir=self.job.workspace) as folder:
            with self.clock.timing("images"), stage_errors("images"):
                images.write(Path(folder))
            yield Path(folder)

    def _reader_options(self, camera: SequenceCamera) -> Any:
        options = pycolmap.ImageReaderOptions()
        options.camera_model = self.settings["camera_model"]
        params: Iterable[float] = ()
        if camera.intrinsics:
            options.camera_model, params = camera.intrinsics.model, camera.intrinsics.params
        elif camera.prior is not None:
            # COLMAP makes the same camera from EXIF, which the grey images do not have.
            found = pycolmap.Camera.create_from_model_name(1, options.camera_model, camera.prior, *camera.size)
            params = found.params
        options.camera_params = ",".join(repr(float(value)) for value in params)
        return options

    def _build_matches(self, folder: Path) -> None:
        features = self._features()
        with self._scratch() as working:
            shutil.copyfile(features, working)
            self._match(working, guided=False, verified=False)
            copy_rows(working, folder / DATABASE, "matches")

    def _build_geometry(self, folder: Path) -> None:
        matches, features = self._matches(), self._features()
        guided = self._matching["matching.guided_matching"] is True
        with self._scratch() as working:
            copy_database(features, working, without=() if guided else {"descriptors"})
            add_rows(matches, working, "matches")
            if guided:
                self._match(working, guided=True, verified=True)
            else:
                self._verify(working)
            copy_database(working, folder / DATABASE, without={"descriptors", "matches"})

    def _verify(self, database: Path) -> None:
        options = pycolmap.GeometricVerifierOptions()
        options.num_threads = self.job.threads
        options.rig_verification = self._matching["matching.rig_verification"]
        pycolmap.geometric_verification(
            database, options, pycolmap.ExistingMatchedPairingOptions(), self.options["verification"]
        )

    def _match(self, database: Path, *, guided: bool, verified: bool) -> None:
        """Match pairs that have no matches yet, and verify them if asked to."""
        matching = copy.copy(self.options["matching"])
        matching.guided_matching = guided
        matching.skip_geometric_verification = not verified
        match, pairing = pycolmap.match_exhaustive, copy.copy(self.options["pairing"])
        if self.settings["pairing"] == "sequential":
            match = pycolmap.match_sequential
            pairing.vocab_tree_path = self.settings["vocab_tree_path"]
        with self._device() as device:
            match(database, matching, pairing, self.options["verification"], device)

    def _build_calibration(self, folder: Path) -> None:
        geometry, matches = self.geometry(), self._matches()
        with self._scratch() as working:
            shutil.copyfile(geometry, working)
            # Relative poses are estimated anew from all matches: a pair without them would lose its geometry.
            add_rows(matches, working, "matches")
            if not pycolmap.calibrate_view_graph(working, self.options["view_graph"]):
                raise RunError("the focal length could not be estimated from the verified pairs; give the intrinsics")
            copy_database(working, folder / DATABASE, without={"matches"})

    @contextlib.contextmanager
    def _scratch(self) -> Iterator[Path]:
        """Yield the path of a database that exists for one step only."""
        with tempfile.TemporaryDirectory(dir=self.job.workspace) as folder:
            yield Path(folder) / DATABASE


@contextlib.contextmanager
def stage_errors(stage: str) -> Iterator[None]:
    """Turn what pycolmap raises inside a stage into a `RunError` that names it."""
    try:
        yield
    except (RuntimeError, ValueError) as error:
        raise RunError(f"COLMAP stopped in stage '{stage}': {error}") from error
