"""Run GLOMAP, COLMAP's global mapper, through pycolmap."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

import pycolmap

from gtf_tune.pipelines.base import PipelineJob
from gtf_tune.pipelines.colmap.family import PycolmapPipeline, pycolmap_version, run_to_models, settings_of
from gtf_tune.pipelines.colmap.options import OptionRoot
from gtf_tune.pipelines.colmap.positioning import SplitRefused, map_from_positions, positioning_options, store_positions
from gtf_tune.pipelines.colmap.stages import VIEW_GRAPH, StagedRun

# A seed switches this off. Without one GLOMAP orders by memory address: equal runs in one process then differ.
_SWITCHED_OFF_BY_SEEDS = frozenset({"use_parameter_block_ordering"})


class GlomapPipeline(PycolmapPipeline):
    """Run global mapping; where intrinsics of a camera are unknown, the view graph is calibrated first.

    Everything up to global positioning is a stage of its own (see `glomap_positioning`), shared by trials that differ
    in bundle adjustment, retriangulation or ``mapper.max_normalized_reproj_error`` only.
    """

    roots: ClassVar[Mapping[str, OptionRoot]] = {
        "view_graph": VIEW_GRAPH,
        "mapping": OptionRoot(
            "GlobalPipelineOptions",
            "mapping",
            {(): "pipeline", ("mapper",): "mapper"},
            pinned=_SWITCHED_OFF_BY_SEEDS,
        ),
    }

    def own_stages(self, job: PipelineJob) -> tuple[str, ...]:
        """Return the stages up to global positioning."""
        known = all(camera.intrinsics for camera in job.images.sequence.cameras)
        return ("positioning",) if known else ("calibration", "positioning")

    def map(self, staged: StagedRun) -> list[Any]:
        """Return the models that GLOMAP finds, the same to the last bit as one uninterrupted run of it."""
        known = staged.intrinsics_known
        database = staged.geometry() if known else staged.calibration()
        key = staged.key(
            "positioning",
            database=staged.geometry_key if known else staged.calibration_key,
            options=positioning_options(staged.options.values["mapping"]),
            seed=staged.job.seed,
        )
        options = staged.options["mapping"]

        def build(folder: Path) -> None:
            with staged.opened(database) as opened:
                store_positions(options, opened, folder)

        positions = staged.reach("positioning", key, build)
        with staged.opened(database) as opened:
            try:
                return map_from_positions(options, opened, positions)
            except SplitRefused:
                return run_to_models(lambda manager: pycolmap.GlobalPipeline(options, opened, manager))


def create(settings: Mapping[str, object]) -> GlomapPipeline:
    """Return the pipeline ``glomap``."""
    return GlomapPipeline("glomap", pycolmap_version(), settings_of("glomap", settings))
