"""Compare the pairs that `sequence inspect` calls turns of the camera with ground truth.

Ground truth says by how many pixels features move once the true rotation is taken out (parallax), and under which angle
they are seen from both images. A pair only turns where half of its matches have a parallax below the two pixels within
which a homography explains them; where it is more than twice that, calling it a turn is a false alarm. In between both
answers are right.

    GTF_TUNE_DATA=... python -m benchmarks.turning_pairs [SEQUENCE ...]
"""

import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from gtf_tune.cli.terminal.console import write_line, write_table
from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Sequence, load_sequence
from gtf_tune.sequence.content import match_features, pair_content
from gtf_tune.sequence.turning import turning_pairs

TURN_PX, MOTION_PX = 2.0, 4.0
STILL_PX = 0.5


@dataclass(frozen=True)
class Pair:
    """Two successive frames: what ground truth says of them, and whether they are called a turn.

    ``known`` and ``unknown`` are the answers with intrinsics and without. Angles are in degrees.
    """

    first: int
    turn_deg: float
    parallax_px: float
    angle_deg: float
    known: bool
    unknown: bool


def pairs_of(sequence: Sequence) -> Iterator[Pair]:
    """Yield the pairs of a sequence with ground truth and a PINHOLE camera whose images differ and can be matched."""
    images = [sequence.read_grey(frame) for frame in sequence.frames]
    numbers = range(len(images) - 1)
    contents = [pair_content((n, n + 1), images[n], images[n + 1]) for n in numbers]
    homographies, size = [content.homography for content in contents], (sequence.width, sequence.height)
    known, unknown = (turning_pairs(homographies, size, camera) for camera in (sequence.camera, None))
    for n in numbers:
        if contents[n].shift_px >= STILL_PX:
            turn, parallax, angle = _truth(sequence, n, match_features(images[n], images[n + 1]))
            yield Pair(n, turn, parallax, angle, known[n], unknown[n])


def _truth(sequence: Sequence, number: int, matches: tuple[NDArray[np.float32], ...]) -> tuple[float, float, float]:
    """Return the turn between two frames, and the medians over matches of the parallax and of the angle of the rays."""
    if sequence.ground_truth is None or sequence.camera is None:
        raise SequenceError(f"{sequence.root}: expected ground truth and intrinsics")
    fx, fy, cx, cy = sequence.camera.params
    matrix = np.array([[fx, 0, cx - 0.5], [0, fy, cy - 0.5], [0, 0, 1]])
    rotations = sequence.ground_truth.rotations
    turn = rotations[number + 1].inv() * rotations[number]
    first, second = (np.column_stack([points, np.ones(len(points))]) @ np.linalg.inv(matrix).T for points in matches)
    turned = first @ turn.as_matrix().T
    pixels = (turned @ matrix.T)[:, :2] / turned[:, 2:]
    cosines = (turned * second).sum(axis=1) / np.linalg.norm(turned, axis=1) / np.linalg.norm(second, axis=1)
    angles = np.degrees(np.arccos(np.clip(cosines, -1, 1)))
    parallax = np.linalg.norm(pixels - matches[1], axis=1)
    return float(np.degrees(turn.magnitude())), float(np.median(parallax)), float(np.median(angles))


def main(names: list[str]) -> None:
    """Print a table of all sequences, then the pairs that are turns or are called so."""
    data = Path(os.environ["GTF_TUNE_DATA"])
    chosen = names or sorted(path.name for path in data.iterdir() if path.is_dir())
    found = {name: list(pairs_of(load_sequence(data / name))) for name in chosen}
    header = ["sequence", ">pairs", ">turns", ">missed", ">missed, K unknown", ">false", ">false, K unknown"]
    rows = []
    for name, pairs in found.items():
        turns = [pair for pair in pairs if pair.parallax_px < TURN_PX]
        moves = [pair for pair in pairs if pair.parallax_px > MOTION_PX]
        missed = [sum(not getattr(pair, how) for pair in turns) for how in ("known", "unknown")]
        false = [sum(getattr(pair, how) for pair in moves) for how in ("known", "unknown")]
        rows.append([name, *map(str, (len(pairs), len(turns), *missed, *false))])
    write_table(header, rows)
    write_line("")
    listed = [
        [f"{name} {pair.first}", f"{pair.turn_deg:.1f}", f"{pair.parallax_px:.1f}", f"{pair.angle_deg:.2f}"]
        + ["yes" if answer else "no" for answer in (pair.known, pair.unknown)]
        for name, pairs in found.items()
        for pair in pairs
        if pair.known or pair.unknown or pair.parallax_px < TURN_PX
    ]
    write_table(["pair", ">turn [deg]", ">parallax [px]", ">angle [deg]", "called", "called, K unknown"], listed)


if __name__ == "__main__":
    main(sys.argv[1:])
