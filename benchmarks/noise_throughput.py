"""Measure how fast noisy images are made, against the plain loop, a pure copy and the features read from them.

Run ``python benchmarks/noise_throughput.py [--json FILE]``. Everything runs in one process on one thread, interleaved;
figures are medians, ratios of medians are what matters. The last table is why images are written as PGM.
"""

import argparse
import json
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pycolmap

from gtf_tune.sequence import ImageSource, Sequence, load_sequence
from gtf_tune.sequence.image_noise import GreyImage
from gtf_tune.sequence.render.textures import poster

IMAGES, HEIGHT, WIDTH = 8, 683, 1024
SIGMA = 5.0
ROUNDS = 9
FORMATS = {
    "pgm": (".pgm", []),
    "bmp": (".bmp", []),
    "tiff, uncompressed": (".tif", [cv2.IMWRITE_TIFF_COMPRESSION, 1]),
    "png, level 0": (".png", [cv2.IMWRITE_PNG_COMPRESSION, 0]),
    "png, level 1": (".png", [cv2.IMWRITE_PNG_COMPRESSION, 1]),
}


@dataclass(frozen=True)
class Speed:
    """How long one way of making an image takes, and its images per second against two references."""

    name: str
    milliseconds: float
    images_per_s: float
    over_plain_loop: float
    share_of_copy: float


@dataclass(frozen=True)
class FormatSpeed:
    """How long one image takes to be written by OpenCV and to be read by pycolmap."""

    name: str
    write_ms: float
    pycolmap_read_ms: float
    size_kb: float


def make_sequence(folder: Path) -> Sequence:
    folder.mkdir()
    for number in range(IMAGES):
        picture = poster(HEIGHT, WIDTH, np.random.default_rng(number))
        cv2.imwrite(str(folder / f"{number:06d}.png"), np.rint(picture).astype(np.uint8))
    return load_sequence(folder)


def plain_loop(sequence: Sequence, folder: Path) -> None:
    for frame in sequence.frames:
        grey = np.asarray(cv2.imread(str(frame.path), cv2.IMREAD_GRAYSCALE))
        noisy = np.clip(np.rint(grey + np.random.normal(0, SIGMA, grey.shape)), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"{frame.frame_id:06d}.png"), noisy)


def copy_loop(sequence: Sequence, folder: Path) -> None:
    for frame in sequence.frames:
        grey = np.asarray(cv2.imread(str(frame.path), cv2.IMREAD_GRAYSCALE))
        cv2.imwrite(str(folder / f"{frame.frame_id:06d}.png"), grey)


def timed(work: Callable[[], object]) -> float:
    """Return milliseconds of processor time: the wall clock of a shared machine says more about its other users."""
    start = time.process_time()
    work()
    return (time.process_time() - start) * 1e3


def medians(works: dict[str, Callable[[], object]]) -> dict[str, float]:
    """Return the median milliseconds per image of each way, measured in turns."""
    times: dict[str, list[float]] = {name: [] for name in works}
    for _ in range(ROUNDS):
        for name, work in works.items():
            times[name].append(timed(work) / IMAGES)
    return {name: statistics.median(values) for name, values in times.items()}


def measure_speeds(sequence: Sequence, folder: Path) -> list[Speed]:
    plain, copy = "plain loop: imread, np.random.normal, imwrite", "copy: imread, imwrite"
    found = medians(
        {
            plain: partial(plain_loop, sequence, folder),
            copy: partial(copy_loop, sequence, folder),
            "gtf-tune, noisy": partial(ImageSource(sequence, sigma=SIGMA, seed=1).write, folder),
            "gtf-tune, clean": partial(ImageSource(sequence).write, folder),
        }
    )
    return [Speed(name, ms, 1e3 / ms, found[plain] / ms, found[copy] / ms) for name, ms in found.items()]


def write_all(paths: list[str], pictures: list[GreyImage], options: list[int]) -> None:
    for path, picture in zip(paths, pictures, strict=True):
        cv2.imwrite(path, picture, options)


def read_all(paths: list[str]) -> None:
    for path in paths:
        pycolmap.Bitmap.read(path, False)


def thread_gain(sequence: Sequence, folder: Path) -> float:
    """Return how many times faster two threads write than one, by the wall clock."""
    source = ImageSource(sequence, sigma=SIGMA, seed=1)
    seconds: dict[int, list[float]] = {1: [], 2: []}
    for _ in range(ROUNDS):
        for threads, times in seconds.items():
            start = time.perf_counter()
            source.write(folder, threads=threads)
            times.append(time.perf_counter() - start)
    return statistics.median(seconds[1]) / statistics.median(seconds[2])


def measure_formats(sequence: Sequence, folder: Path) -> list[FormatSpeed]:
    source = ImageSource(sequence, sigma=SIGMA, seed=1)
    pictures = [source.read(frame) for frame in sequence.frames]
    rows = []
    for name, (suffix, options) in FORMATS.items():
        paths = [str(folder / f"{number}{suffix}") for number in range(IMAGES)]
        found = medians(
            {"write": partial(write_all, paths, pictures, options), "read": partial(read_all, paths)},
        )
        rows.append(FormatSpeed(name, found["write"], found["read"], Path(paths[0]).stat().st_size / 1e3))
    return rows


def measure_features_ms(sequence: Sequence, folder: Path) -> float:
    """Return the milliseconds per image that pycolmap takes for SIFT features of our files, on one thread."""
    images = folder / "features"
    images.mkdir()
    ImageSource(sequence, sigma=SIGMA, seed=1).write(images)
    options = pycolmap.FeatureExtractionOptions()
    options.num_threads = 1
    options.use_gpu = False
    pycolmap.logging.minloglevel = pycolmap.logging.ERROR.value
    extract = partial(
        pycolmap.extract_features,
        folder / "features.db",
        images,
        extraction_options=options,
        device=pycolmap.Device.cpu,
    )
    return timed(extract) / IMAGES


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the tables here too")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        sequence = make_sequence(folder / "images")
        speeds, formats = measure_speeds(sequence, folder), measure_formats(sequence, folder)
        features_ms, gain = measure_features_ms(sequence, folder), thread_gain(sequence, folder)
    print(f"{IMAGES} images of {WIDTH}x{HEIGHT}, one thread, processor time per image")
    print(f"{'':46s}{'ms':>8s}{'images/s':>10s}{'x plain':>9s}{'x copy':>8s}")
    for row in speeds:
        figures = f"{row.milliseconds:8.2f}{row.images_per_s:10.0f}{row.over_plain_loop:9.2f}{row.share_of_copy:8.2f}"
        print(f"{row.name:46s}{figures}")
    noisy_ms = next(row.milliseconds for row in speeds if row.name == "gtf-tune, noisy")
    print(f"SIFT features by pycolmap: {features_ms:.0f} ms; noisy images cost {noisy_ms / features_ms:.1%} of that")
    print(f"two threads write {gain:.2f} times as fast as one, by the wall clock")
    print(f"\n{'format':46s}{'write ms':>8s}{'pycolmap read ms':>18s}{'kB':>8s}")
    for kind in formats:
        print(f"{kind.name:46s}{kind.write_ms:8.2f}{kind.pycolmap_read_ms:18.2f}{kind.size_kb:8.0f}")
    if arguments.json:
        table = {
            "speeds": [asdict(row) for row in speeds],
            "formats": [asdict(kind) for kind in formats],
            "features_ms": features_ms,
            "gain_of_two_threads": gain,
        }
        arguments.json.write_text(json.dumps(table, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
