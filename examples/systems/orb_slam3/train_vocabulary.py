"""Train a small vocabulary of ORB descriptors for ORB-SLAM3, whose own (145 MB) is not part of the package.

Usage: train_vocabulary.py OUTPUT FOLDER_OF_IMAGES [FOLDER_OF_IMAGES ...]

Descriptors are clustered again and again into `BRANCHES` groups whose centres are majority votes of bits (Galvez-Lopez
and Tardos 2012). The text format is that of DBoW2: a line for each node, parents first, with the number of the parent,
whether it is a leaf, 32 bytes and a weight.
"""

import sys
from pathlib import Path

import cv2
import numpy as np

BRANCHES, LEVELS = 10, 5
_ITERATIONS = 5
_FEATURES = 500


def descriptors_of(folders: list[str], most_images: int = 60) -> list[np.ndarray]:
    """Return the descriptors of each image, every n-th one so that there are not too many."""
    paths = sorted(path for folder in folders for path in Path(folder).rglob("*.png"))
    orb = cv2.ORB_create(_FEATURES)
    found = [
        orb.detectAndCompute(cv2.imread(str(path), 0), None)[1] for path in paths[:: -(-len(paths) // most_images)]
    ]
    return [one for one in found if one is not None]


def clusters(bits: np.ndarray, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return the centres of groups of descriptors, and the group of each descriptor; ``bits`` are (N, 256), 0 or 1."""
    centres = bits[rng.choice(len(bits), BRANCHES, replace=False)].astype(np.float32)
    signs = bits.astype(np.float32)
    for _ in range(_ITERATIONS):
        # Hamming distances but for a term of the descriptor alone: |c| - 2 b.c
        group = np.argmin(centres.sum(axis=1) - 2 * signs @ centres.T, axis=1)
        for index in range(BRANCHES):
            if (group == index).any():
                centres[index] = signs[group == index].mean(axis=0) > 0.5
    return centres.astype(np.uint8), group


def write_vocabulary(path: Path, images: list[np.ndarray], seed: int = 0) -> int:
    """Write the vocabulary of descriptors, given by image, and return its number of words."""
    rng = np.random.default_rng(seed)
    bits = np.unpackbits(np.concatenate(images), axis=1)
    image_of = np.repeat(np.arange(len(images)), [len(one) for one in images])
    lines, words = [f"{BRANCHES} {LEVELS} 0 0"], 0
    waiting = [(0, 1, np.arange(len(bits)))]
    while waiting:
        parent, level, members = waiting.pop(0)
        centres, group = clusters(bits[members], rng)
        for index in range(BRANCHES):
            mine = members[group == index]
            if not len(mine):
                continue
            is_leaf = level == LEVELS or len(mine) < 2 * BRANCHES
            words += is_leaf
            weight = np.log(len(images) / len(np.unique(image_of[mine]))) if is_leaf else 0.0
            numbers = " ".join(map(str, np.packbits(centres[index])))
            lines.append(f"{parent} {int(is_leaf)} {numbers} {weight:.6f}")
            if not is_leaf:
                waiting.append((len(lines) - 1, level + 1, mine))
    path.write_text("\n".join(lines))  # a last empty line would be read as one more node
    return words


if __name__ == "__main__":
    count = write_vocabulary(Path(sys.argv[1]), descriptors_of(sys.argv[2:]))
    sys.stdout.write(f"{count} words\n")
