"""Run any program as a pipeline."""

from gtf_tune.pipelines.command.pipeline import PLACEHOLDERS, CommandPipeline, create
from gtf_tune.pipelines.command.preset_files import how_tried, load_preset, preset_names

__all__ = ["PLACEHOLDERS", "CommandPipeline", "create", "how_tried", "load_preset", "preset_names"]
