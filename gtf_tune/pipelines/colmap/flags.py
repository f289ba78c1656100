"""Name options of the pycolmap pipelines as COLMAP's command line and project files name them.

``flags.txt`` lists the names that COLMAP 4's ``option_manager.cc`` registers, and those without a section that
its ``view_graph_calibrator`` takes; an option without a name there can be set from pycolmap only.
"""

from collections.abc import Iterator
from functools import cache
from importlib.resources import files

# Prefix of the dotted path, and how the command line starts instead; the first that fits and exists counts.
_SHARED = (
    ("extraction.sift.", "SiftExtraction."),
    ("extraction.aliked.", "AlikedExtraction."),
    ("extraction.", "FeatureExtraction."),
    ("matching.sift.", "SiftMatching."),
    ("matching.aliked.", "AlikedMatching."),
    ("matching.", "FeatureMatching."),
    ("exhaustive.", "ExhaustiveMatching."),
    ("sequential.", "SequentialMatching."),
    ("verification.ransac.", "TwoViewGeometry."),
)
_GLOBAL = (
    ("mapper.bundle_adjustment.ceres.solver_options.", "GlobalMapper.ba_ceres_"),
    ("mapper.bundle_adjustment.ceres.", "GlobalMapper.ba_ceres_"),
    ("mapper.bundle_adjustment.", "GlobalMapper.ba_"),
    ("mapper.global_positioning.", "GlobalMapper.gp_"),
    ("mapper.retriangulation.", "GlobalMapper.tri_"),
    ("mapper.rotation_averaging.", "GlobalMapper.ra_"),
    ("mapper.", "GlobalMapper."),
    ("pipeline.", "GlobalMapper."),
    ("view_graph.", ""),
)
_INCREMENTAL = (
    ("triangulation.", "Mapper.tri_"),
    ("mapper.ba_global_prune_points_", "Mapper.ba_global_ignore_redundant_points3D_"),
    ("mapper.", "Mapper."),
    ("pipeline.", "Mapper."),
)
_HIERARCHICAL = (
    ("clustering.", "HierarchicalMapper."),
    ("hierarchical.", "HierarchicalMapper."),
    *_INCREMENTAL,
)
_MAPPERS = {"glomap": _GLOBAL, "colmap": _INCREMENTAL, "colmap-hierarchical": _HIERARCHICAL}
_CALIBRATOR = "view_graph_calibrator"
_LAST_COMMANDS = {
    "ImageReader": "feature_extractor",
    "glomap": (_CALIBRATOR, "global_mapper"),
    "colmap": ("mapper",),
    "colmap-hierarchical": ("hierarchical_mapper",),
}
_COMMANDS = {
    "ImageReader": "feature_extractor",
    "FeatureExtraction": "feature_extractor",
    "SiftExtraction": "feature_extractor",
    "AlikedExtraction": "feature_extractor",
    "FeatureMatching": "exhaustive_matcher",
    "SiftMatching": "exhaustive_matcher",
    "AlikedMatching": "exhaustive_matcher",
    "TwoViewGeometry": "exhaustive_matcher",
    "ExhaustiveMatching": "exhaustive_matcher",
    "SequentialMatching": "sequential_matcher",
    "Mapper": "mapper",
    "HierarchicalMapper": "hierarchical_mapper",
    "GlobalMapper": "global_mapper",
}


def flag_of(pipeline: str, option: str) -> str | None:
    """Return COLMAP's name of an option, mostly ``Section.name``, or ``None`` where its command line has none."""
    return next((flag for flag in _candidates(pipeline, option) if flag in _flags()), None)


def commands_of(pipeline: str, pairing: str = "exhaustive") -> tuple[str, ...]:
    """Return the COLMAP commands of a pipeline in the order in which they run."""
    return ("feature_extractor", f"{pairing}_matcher", *_LAST_COMMANDS[pipeline])


def command_of(pipeline: str, flag: str, pairing: str = "exhaustive") -> str:
    """Return the COLMAP command of a pipeline that reads a flag, for example ``feature_extractor``."""
    section, dot, _ = flag.partition(".")
    command = _COMMANDS[section] if dot else _CALIBRATOR
    if command == "mapper" and pipeline == "colmap-hierarchical":
        return "hierarchical_mapper"
    return f"{pairing}_matcher" if command.endswith("_matcher") else command


def _candidates(pipeline: str, option: str) -> Iterator[str]:
    # TwoViewGeometry.min_inlier_ratio is RANSAC's on the command line, so verification's own has no flag.
    for start, flag in (*_SHARED, *_MAPPERS.get(pipeline, ())):
        if option.startswith(start):
            yield flag + option.removeprefix(start)
    if option.startswith("verification.") and option != "verification.min_inlier_ratio":
        yield "TwoViewGeometry." + option.removeprefix("verification.")


@cache
def _flags() -> frozenset[str]:
    text = files("gtf_tune.pipelines.colmap").joinpath("flags.txt").read_text(encoding="ascii")
    return frozenset(text.split())
