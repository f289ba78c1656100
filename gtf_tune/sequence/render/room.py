"""Render a sequence with exact ground truth: a textured room seen by a hand-held camera."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from os import PathLike
from pathlib import Path

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from gtf_tune.errors import SequenceError
from gtf_tune.sequence.camera import Camera
from gtf_tune.sequence.image_noise import GreyImage
from gtf_tune.sequence.render.motion import WALKS, HandHeldPath, Motion, random_path
from gtf_tune.sequence.render.raster import FloatImage, TextureAtlas, build_atlas, draw
from gtf_tune.sequence.render.scene import Face, FloatArray, build_room

# A rotated grid of four samples: smooth edges in both directions, and four moments of the exposure.
_SUBPIXELS = np.array(((-0.125, -0.375), (0.375, -0.125), (-0.375, 0.125), (0.125, 0.375)))


@dataclass(frozen=True)
class RoomSpec:
    """Describe a rendered sequence; equal specs give equal images.

    ``sensor_noise`` is in grey levels. ``exposure`` is the share of the time between two frames that the shutter is
    open, which is the motion blur. ``flicker`` is the relative deviation of the brightness from frame to frame.
    ``motion`` is how the camera moves (see `gtf_tune.sequence.render.motion`); ``contrast`` scales the textures about
    their means, so that a small one leaves few features.

    Raises
    ------
    SequenceError
        A number is outside its range.
    """

    num_frames: int = 18
    width: int = 360
    height: int = 270
    frame_rate_hz: float = 5.0
    sensor_noise: float = 3.0
    exposure: float = 0.04
    flicker: float = 0.08
    seed: int = 0
    motion: Motion = "arc"
    contrast: float = 1.0

    def __post_init__(self) -> None:
        lowest = {"num_frames": 2, "width": 64, "height": 64, "sensor_noise": 0, "exposure": 0, "flicker": 0, "seed": 0}
        lowest["contrast"] = 0
        for name, low in lowest.items():
            if not getattr(self, name) >= low:
                raise SequenceError(f"{name} of a rendered room must be at least {low}, not {getattr(self, name)}")
        if not self.frame_rate_hz > 0:
            raise SequenceError(f"frame_rate_hz of a rendered room must be positive, not {self.frame_rate_hz}")
        if self.motion not in WALKS:
            raise SequenceError(f"motion of a rendered room must be one of {', '.join(WALKS)}, not '{self.motion}'")

    @property
    def camera(self) -> Camera:
        """Return the intrinsics: a field of view of 65 degrees across, centre of the image."""
        focal = self.width / (2 * np.tan(np.deg2rad(32.5)))
        return Camera("PINHOLE", self.width, self.height, (focal, focal, self.width / 2, self.height / 2))


@dataclass(frozen=True, eq=False)
class _Studio:
    """What all frames of one rendering share."""

    spec: RoomSpec
    faces: tuple[Face, ...]
    atlas: TextureAtlas
    path: HandHeldPath

    def progress(self, frame: float) -> float:
        return frame / (self.spec.num_frames - 1)

    def picture(self, frame: int) -> GreyImage:
        """Return the image of a frame: blurred by motion, of the frame's brightness, with sensor noise."""
        light = np.zeros((self.spec.height, self.spec.width), np.float32)
        moments = (np.arange(len(_SUBPIXELS)) + 0.5) / len(_SUBPIXELS) - 0.5
        for moment, (across, down) in zip(moments, _SUBPIXELS, strict=True):
            fx, fy, cx, cy = self.spec.camera.params
            shifted = Camera("PINHOLE", self.spec.width, self.spec.height, (fx, fy, cx - across, cy - down))
            pose = self.path.pose(self.progress(frame + moment * self.spec.exposure))
            light += draw(self.faces, self.atlas, shifted, pose)
        return self._exposed(light / np.float32(len(_SUBPIXELS)), frame)

    def _exposed(self, light: FloatImage, frame: int) -> GreyImage:
        # A generator of the frame's own keeps images independent of the order in which threads draw them.
        rng = np.random.default_rng((self.spec.seed, frame + 1))
        gain = 1 + self.spec.flicker * rng.standard_normal()
        noise = self.spec.sensor_noise * rng.standard_normal(light.shape, dtype=np.float32)
        return np.clip(np.rint(light * gain + noise), 0, 255).astype(np.uint8)


_DEFAULT = RoomSpec()


def render_room(folder: str | PathLike[str], spec: RoomSpec = _DEFAULT, threads: int = 2) -> Path:
    """Render a sequence into a folder in the layout of ETH3D SLAM and return the folder.

    Writes rgb/000000.png and so on (8-bit grey), rgb.txt, groundtruth.txt (world_from_camera at the middle of the
    exposure, exact) and calibration.txt. The images do not depend on ``threads``.

    Raises
    ------
    SequenceError
        The folder already holds a sequence, or cannot be written to.
    """
    root = Path(folder).expanduser().absolute()
    if (root / "rgb.txt").exists():
        raise SequenceError(f"{root}: there already is a sequence; give a new folder, or delete this one")
    try:
        (root / "rgb").mkdir(parents=True, exist_ok=True)
        studio = _build_studio(spec)
        with ThreadPoolExecutor(threads) as pool:
            for frame, picture in enumerate(pool.map(studio.picture, range(spec.num_frames))):
                (root / _image_name(frame)).write_bytes(cv2.imencode(".png", picture)[1].data)
        _write_tables(root, studio)
    except OSError as error:
        raise SequenceError(f"{root}: cannot write the sequence ({error.strerror}); check folder and disk") from error
    return root


def _build_studio(spec: RoomSpec) -> _Studio:
    rng = np.random.default_rng((spec.seed, 0))
    faces = tuple(face.with_contrast(spec.contrast) for face in build_room(rng))
    return _Studio(spec, faces, build_atlas(faces), random_path(rng, spec.motion))


def _image_name(frame: int) -> str:
    return f"rgb/{frame:06d}.png"


def _write_tables(root: Path, studio: _Studio) -> None:
    images, poses = ["# timestamp filename"], ["# timestamp tx ty tz qx qy qz qw (world_from_camera)"]
    for frame in range(studio.spec.num_frames):
        stamp = f"{frame / studio.spec.frame_rate_hz:.6f}"
        images.append(f"{stamp} {_image_name(frame)}")
        poses.append(f"{stamp} {_pose_text(studio.path.pose(studio.progress(frame)))}")
    fx, fy, cx, cy = studio.spec.camera.params
    (root / "calibration.txt").write_text(f"{fx!r} {fy!r} {cx - 0.5!r} {cy - 0.5!r}\n")
    (root / "groundtruth.txt").write_text("\n".join(poses) + "\n")
    (root / "rgb.txt").write_text("\n".join(images) + "\n")


def _pose_text(pose: FloatArray) -> str:
    numbers = (*pose[:3, 3], *Rotation.from_matrix(pose[:3, :3]).as_quat())
    return " ".join(f"{number:.12g}" for number in numbers)
