"""State what a pipeline is, find pipelines by name, and describe runs of them as values."""

from gtf_tune.pipelines.base import DiagnosticValue, Pipeline, PipelineJob, PipelineOutput, Stages
from gtf_tune.pipelines.focal_prior import with_focal_prior
from gtf_tune.pipelines.options import OptionSpec, OptionTable, OptionValue, option_text
from gtf_tune.pipelines.registry import ENTRY_POINT_GROUP, PipelineFactory, create_pipeline, pipeline_names
from gtf_tune.pipelines.run import RunKind, RunOutcome, RunRequest, RunStatus, digest

__all__ = [
    "ENTRY_POINT_GROUP",
    "DiagnosticValue",
    "OptionSpec",
    "OptionTable",
    "OptionValue",
    "Pipeline",
    "PipelineFactory",
    "PipelineJob",
    "PipelineOutput",
    "RunKind",
    "RunOutcome",
    "RunRequest",
    "RunStatus",
    "Stages",
    "create_pipeline",
    "digest",
    "option_text",
    "pipeline_names",
    "with_focal_prior",
]
