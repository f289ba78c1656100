"""A Python function as a pipeline, and pipelines that are named ``module:attribute``."""

from gtf_tune.pipelines.function.images import RunImages
from gtf_tune.pipelines.function.imported import create_imported
from gtf_tune.pipelines.function.pipeline import FunctionPipeline, SlamFunction, from_function

__all__ = ["FunctionPipeline", "RunImages", "SlamFunction", "create_imported", "from_function"]
