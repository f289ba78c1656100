"""Run DROID-SLAM on one folder of images; a script for the Python that DROID-SLAM is installed in.

It knows nothing of gtf-tune, follows DROID-SLAM's demo.py step by step, and runs on Python 3.8 and later.

Usage: driver.py JOB, a JSON file with checkout, weights, images, intrinsics, distortion, options, seed, poses, outcome.
The poses are written as lines of ``index x y z qx qy qz qw``, world_from_camera; the outcome is a JSON file with
``error`` (a sentence) or with figures of the run.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import random
import sys
import time
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any

# demo.py works on about this many pixels, in images whose sides are multiples of 8.
_WORKING_PIXELS = 384 * 512
_CELL = 8
_FILLED_AT_ONCE = 16
_POSE_NUMBERS = 7


class DriverError(Exception):
    """Signal a run that failed for a known reason."""


def main(job_path: str) -> int:
    """Run the job and return the exit code."""
    # The folder of this script is no place to import from.
    del sys.path[0]
    with open(job_path, encoding="utf-8") as file:
        job = json.load(file)
    try:
        outcome = run(job)
    except DriverError as error:
        outcome = {"error": str(error)}
    with open(job["outcome"], "w", encoding="utf-8") as file:
        json.dump(outcome, file)
    return 1 if "error" in outcome else 0


def run(job: dict[str, Any]) -> dict[str, Any]:
    """Track all images, write the poses of all of them, and return figures of the run."""
    torch, droid_class = _import(job)
    if not torch.cuda.is_available():
        raise DriverError(f"DROID-SLAM needs a CUDA device, and torch {torch.__version__} sees none on this machine")
    if not os.path.isfile(job["weights"]):
        raise DriverError(f"DROID-SLAM has no weights at {job['weights']}; download droid.pth as its README says")
    _seed(torch, job["seed"])
    torch.multiprocessing.set_start_method("spawn")
    out_of_memory = getattr(torch.cuda, "OutOfMemoryError", MemoryError)
    try:
        return _run(torch, droid_class, job)
    except out_of_memory as error:
        reason = str(error).splitlines()[0] if str(error) else "no details"
        raise DriverError(
            f"DROID-SLAM ran out of GPU memory ({reason}); lower option 'buffer' or take a larger GPU"
        ) from error


def image_stream(torch: Any, job: dict[str, Any]) -> Iterator[tuple[int, Any, Any]]:
    """Yield (index, image (1, 3, h, w) uint8, intrinsics (4,)) for every image, as demo.py does."""
    import cv2
    import numpy as np

    fx, fy, cx, cy = job["intrinsics"]
    camera = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    for index, path in enumerate(job["images"]):
        image = cv2.imread(path)
        if image is None:
            raise DriverError(f"DROID-SLAM's OpenCV cannot read {path}")
        if job["distortion"]:
            image = cv2.undistort(image, camera, np.array(job["distortion"]))
        h0, w0, _ = image.shape
        h1, w1 = working_size(h0, w0)
        image = cv2.resize(image, (w1, h1))
        image = image[: h1 - h1 % _CELL, : w1 - w1 % _CELL]
        intrinsics = torch.as_tensor([fx, fy, cx, cy])
        intrinsics[0::2] *= w1 / w0
        intrinsics[1::2] *= h1 / h0
        yield index, torch.as_tensor(image).permute(2, 0, 1)[None], intrinsics


def working_size(height: int, width: int) -> tuple[int, int]:
    """Return the height and width that images are resized to, before they are cropped to multiples of 8."""
    factor = math.sqrt(_WORKING_PIXELS / (height * width))
    return int(height * factor), int(width * factor)


def _import(job: dict[str, Any]) -> tuple[Any, Any]:
    sys.path.insert(0, os.path.join(job["checkout"], "droid_slam"))
    try:
        torch = import_module("torch")
        if job["options"]["asynchronous"]:
            return torch, import_module("droid_async").DroidAsync
        return torch, import_module("droid").Droid
    except ImportError as error:
        raise DriverError(
            f"DROID-SLAM cannot be imported by {sys.executable} ({error}); install it there as its README says"
        ) from error


def _seed(torch: Any, seed: int) -> None:
    import numpy as np

    random.seed(seed)
    np.random.seed(seed)
    torch.manual_seed(seed)
    torch.cuda.manual_seed_all(seed)


def _run(torch: Any, droid_class: Any, job: dict[str, Any]) -> dict[str, Any]:
    options = job["options"]
    started = time.perf_counter()
    droid: Any = None
    for index, image, intrinsics in image_stream(torch, job):
        if index % options["stride"]:
            continue
        if droid is None:
            droid = droid_class(_arguments(job, [image.shape[2], image.shape[3]]))
        droid.track(index, image, intrinsics=intrinsics)
        _check_buffer(_keyframes(droid), options["buffer"])
    tracked = time.perf_counter()
    keyframes = _keyframes(droid)
    if not droid.frontend.is_initialized:
        raise DriverError(
            f"DROID-SLAM found {keyframes} keyframes, fewer than the {options['warmup']} it starts with; "
            "lower option 'warmup' or 'filter_thresh', or give it more images"
        )
    poses = droid.terminate(image_stream(torch, job))
    _write_poses(poses, job)
    return {
        "num_keyframes": keyframes,
        "tracking_s": round(tracked - started, 4),
        "terminate_s": round(time.perf_counter() - tracked, 4),
        "peak_gpu_bytes": int(torch.cuda.max_memory_allocated()),
    }


def _arguments(job: dict[str, Any], image_size: list[int]) -> argparse.Namespace:
    """Return what demo.py parses from its command line."""
    options = {name: value for name, value in job["options"].items() if name != "stride"}
    return argparse.Namespace(
        weights=job["weights"],
        image_size=image_size,
        disable_vis=True,
        stereo=False,
        frontend_device="cuda",
        backend_device="cuda",
        **options,
    )


def _keyframes(droid: Any) -> int:
    video = droid.video1 if hasattr(droid, "video1") else droid.video
    return int(video.counter.value)


def _check_buffer(keyframes: int, buffer: int) -> None:
    # The filler puts up to 16 frames behind the keyframes.
    if keyframes + _FILLED_AT_ONCE > buffer:
        raise DriverError(
            f"DROID-SLAM's buffer of {buffer} is too small for more than {keyframes} keyframes; raise option 'buffer'"
        )


def _write_poses(poses: Sequence[Sequence[float]], job: dict[str, Any]) -> None:
    if len(poses) != len(job["images"]) or any(len(pose) != _POSE_NUMBERS for pose in poses):
        raise DriverError(f"DROID-SLAM gave {len(poses)} poses for {len(job['images'])} images")
    with open(job["poses"], "w", encoding="utf-8") as file:
        for index, pose in enumerate(poses):
            file.write(" ".join([str(index), *(repr(float(number)) for number in pose)]) + "\n")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
