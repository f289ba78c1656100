"""Tune my function: any Python function that makes a trajectory of images.

    python examples/tune_function.py photos/

The function here follows a camera that slides along a wall, by the shift of each image against the first. Replace it by
your own: it runs in processes of its own, so that a crash or a hang is one failed run and no more.
"""

import sys

import cv2
import numpy as np

import gtf_tune as gtf


def my_slam(images, options, seed):
    """Return camera centres (n, 3) in pixels and upright orientations (n, 4); images that do not correlate are NaN."""
    grey = [cv2.GaussianBlur(image, (0, 0), options["blur"]) if options["blur"] else image for image in images.arrays]
    fade = cv2.createHanningWindow(grey[0].shape[::-1], cv2.CV_32F) if options["window"] else None
    found = [cv2.phaseCorrelate(np.float32(grey[0]), np.float32(image), fade) for image in grey]
    centres = np.array([(-x, -y, 0.0) if response > 0.01 else (np.nan,) * 3 for (x, y), response in found])
    return centres, np.tile([0.0, 0.0, 0.0, 1.0], (len(images), 1))


def main(photos: str) -> None:
    """Tune the function, and print what to use; started again, go on where it stopped."""
    study = gtf.tune(
        photos,
        name="my-slam",
        pipeline=my_slam,
        nominal={"blur": 0.0, "window": True},
        space={"blur": (0.0, 3.0), "window": [True, False]},
        trials=12,
        gtf={"noise_sigma": 5.0},
    )
    print(study.best.text)
    print(study.best.options)


if __name__ == "__main__":
    main(*sys.argv[1:] or ("photos/",))
