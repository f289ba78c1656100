"""Run DROID-SLAM in its own process and environment."""

from gtf_tune.pipelines.droid_slam.pipeline import DroidSlamPipeline, create

__all__ = ["DroidSlamPipeline", "create"]
