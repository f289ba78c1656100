"""Tune Structure-from-Motion and visual SLAM without ground truth."""

from gtf_tune.version import __version__

__all__ = ["__version__"]
