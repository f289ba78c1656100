"""Stand in for GLOMAP where only the commands round it matter."""

from collections.abc import Mapping
from dataclasses import replace

from gtf_tune.pipelines import PipelineJob, PipelineOutput, analytic
from gtf_tune.pipelines.colmap.glomap import GlomapPipeline
from gtf_tune.pipelines.colmap.glomap import create as create_glomap


class QuickGlomap(GlomapPipeline):
    """Have GLOMAP's name, settings and whole option tree, and the trajectories of the analytic pipeline."""

    def run(self, job: PipelineJob) -> PipelineOutput:
        threshold = job.options.get("mapper.max_normalized_reproj_error", 0.01)
        return analytic.create({}).run(replace(job, options={"filter.max_error": threshold}))


def create(settings: Mapping[str, object]) -> QuickGlomap:
    real = create_glomap(settings)
    return QuickGlomap(real.name, real.version, real.settings)
