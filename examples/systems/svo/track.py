"""Run SVO, as the package svo-cpp has it, on a folder of images: what `svo.toml` starts.

Usage: track.py IMAGES TIMESTAMPS OUTPUT WIDTH,HEIGHT FX,FY,CX,CY [OPTION=VALUE ...]
"""

import json
import sys
from pathlib import Path

import cv2
import svo_cpp


def track(images: Path, times: list[float], output: Path, camera: list[float]) -> None:
    """Track all images in order and write the position of each one that was tracked."""
    odometry = svo_cpp.SVO(svo_cpp.PinholeCamera(*camera))
    odometry.start()
    lines = []
    for path, timestamp in zip(sorted(images.iterdir()), times, strict=True):
        odometry.addImage(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), timestamp)
        if odometry.stage() == svo_cpp.Stage.DEFAULT_FRAME:
            # The package cannot hand over rotations (its unit_quaternion raises a TypeError): they are left out.
            position = odometry.lastFrame().T_f_w.inverse().translation().ravel()
            lines.append(f"{timestamp!r} {position[0]} {position[1]} {position[2]} 0 0 0 1\n")
    if not lines:
        sys.exit("SVO tracked no image")
    output.write_text("".join(lines))


if __name__ == "__main__":
    folder, list_of_times, trajectory, size, intrinsics, *options = sys.argv[1:]
    svo_cpp.set_svo_config({name: json.loads(value) for name, value in (option.split("=") for option in options)})
    stamps = [float(line) for line in Path(list_of_times).read_text().split()]
    track(Path(folder), stamps, Path(trajectory), [float(x) for x in f"{size},{intrinsics}".split(",")])
