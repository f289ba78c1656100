"""A pipeline with a known optimum that needs no images, for tests, tutorials and measurements of overhead."""

from gtf_tune.pipelines.analytic.pipeline import (
    FRAME_RATE_HZ,
    OPTIMUM,
    SETTINGS,
    VERSION,
    AnalyticPipeline,
    create,
    expected_error,
    ground_truth,
    imaginary_sequence,
    missing_share,
)

__all__ = [
    "FRAME_RATE_HZ",
    "OPTIMUM",
    "SETTINGS",
    "VERSION",
    "AnalyticPipeline",
    "create",
    "expected_error",
    "ground_truth",
    "imaginary_sequence",
    "missing_share",
]
