"""Vary the paper's 26 GLOMAP options one by one, as far as COLMAP 4 still has them (the paper's supplement)."""

from collections.abc import Mapping
from pathlib import Path

from experiments.plan import OPTIONS, ROOM, SIGMAS, Experiment, Option

SEQUENCES = (ROOM, "dtu-scan24")

_PAIRS: Mapping[str, tuple[str, tuple[float, ...]]] = {
    "Th. max angle error": ("mapper.max_angular_reproj_error_deg", (0.3, 3.0)),
    "Th. min triangulation angle": ("mapper.min_tri_angle_deg", (0.3, 3.0)),
    "Th. max rotation error": ("mapper.rotation_averaging.max_rotation_error_deg", (3.0, 30.0)),
    "Tr. complete max reproj. error": ("mapper.retriangulation.complete_max_reproj_error", (4.0, 30.0)),
    "Tr. merge max reproj. error": ("mapper.retriangulation.merge_max_reproj_error", (4.0, 30.0)),
    "Tr. min angle": ("mapper.retriangulation.min_angle", (0.3, 3.0)),
    "GP th. loss function": ("mapper.global_positioning.loss_function_scale", (0.03, 0.3)),
    "SIFT ext. edge threshold": ("extraction.sift.edge_threshold", (5.0, 20.0)),
    "SIFT matching max distance": ("matching.sift.max_distance", (0.5, 0.9)),
    "Th. min inlier ratio": ("verification.min_inlier_ratio", (0.1, 0.25)),
    "2V geom. confidence": ("verification.ransac.confidence", (0.99, 0.9999)),
    "2V geom. min inlier ratio": ("verification.ransac.min_inlier_ratio", (0.1, 0.5)),
    "Triang. min num matches": ("pipeline.min_num_matches", (8, 30)),
    "2V geom. min num inliers": ("verification.min_num_inliers", (8, 30)),
}

WITHOUT_SUCCESSOR = ("Th. max epipolar error E", "Th. max epipolar error F", "Th. max epipolar error H")
"""COLMAP 4 has one RANSAC threshold instead; the definitions of these run stand-alone GLOMAP."""

WITHOUT_EFFECT = {
    "RPE max epipolar error": "only where intrinsics are unknown",
    "SIFT ext. dsp max scale": "only with domain-size pooling, off by default",
    "SIFT ext. dsp min scale": "only with domain-size pooling, off by default",
    "Th. min inlier num": "only where intrinsics are unknown",
}
"""Options that COLMAP 4 has, but that do nothing in these studies."""


def pairs() -> Mapping[str, tuple[str, tuple[float, ...]]]:
    """Return the options that the ablation adds to those of table 2, and the ends of their grids, by paper's name."""
    return _PAIRS


def ablation(found: Mapping[str, Path]) -> list[Experiment]:
    """Return one small grid for each option; the five of table 2 have their own."""
    swept = [Option(f"ablation-{name}", name, ends, label) for label, (name, ends) in _PAIRS.items()]
    return [Experiment(name, option, SIGMAS[name]) for name in SEQUENCES if name in found for option in swept]


def swept_elsewhere(found: Mapping[str, Path]) -> list[Experiment]:
    """Return the grids of table 2 on the same sequences."""
    return [
        Experiment(name, option, SIGMAS[name]) for name in SEQUENCES if name in found for option in OPTIONS.values()
    ]
