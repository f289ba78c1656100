"""Run ORB-SLAM3, as the package pyorbslam3 has it, on a folder of images: what `orb_slam3.toml` starts.

Usage: track.py VOCABULARY SETTINGS IMAGES TIMESTAMPS OUTPUT SECONDS_PER_IMAGE
"""

import sys
import time
from pathlib import Path

import cv2
from pyorbslam3 import Sensor, Slam


def track(vocabulary: str, settings: str, images: Path, times: list[float], output: str, pace_s: float) -> None:
    """Track all images in order and write a pose for each one that was tracked."""
    slam = Slam(vocabulary, settings, Sensor.MONOCULAR)
    paths = sorted(images.iterdir())
    for path, timestamp in zip(paths, times, strict=True):
        began = time.monotonic()
        slam.track_monocular(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), timestamp)
        # Mapping goes on in another thread: without a pause it falls behind, and tracking is lost.
        time.sleep(max(pace_s - (time.monotonic() - began), 0.0))
    slam.shutdown()
    slam.save_trajectory_euroc(output)  # the only one of its formats that has all frames of one camera


if __name__ == "__main__":
    words, settings_file, folder, list_of_times, trajectory, seconds = sys.argv[1:]
    stamps = [float(line) for line in Path(list_of_times).read_text().split()]
    track(words, settings_file, Path(folder), stamps, trajectory, float(seconds))
