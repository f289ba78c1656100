"""Run COLMAP's incremental and hierarchical mappers through pycolmap."""

from collections.abc import Mapping
from typing import Any, ClassVar

import pycolmap

from gtf_tune.pipelines.colmap.family import PycolmapPipeline, pycolmap_version, run_to_models, settings_of
from gtf_tune.pipelines.colmap.options import OptionRoot
from gtf_tune.pipelines.colmap.stages import StagedRun


class ColmapPipeline(PycolmapPipeline):
    """Run incremental mapping: an initial pair, then one image after the other."""

    roots: ClassVar[Mapping[str, OptionRoot]] = {
        "mapping": OptionRoot(
            "IncrementalPipelineOptions",
            "mapping",
            {(): "pipeline", ("mapper",): "mapper", ("triangulation",): "triangulation"},
        )
    }

    def map(self, staged: StagedRun) -> list[Any]:
        """Return the models that incremental mapping finds."""
        options = staged.options["mapping"]
        options.extract_colors = False
        with staged.opened(staged.geometry()) as database:
            return run_to_models(lambda manager: pycolmap.IncrementalPipeline(options, database, manager))


class HierarchicalPipeline(PycolmapPipeline):
    """Run incremental mapping on overlapping clusters of images, and merge them."""

    roots: ClassVar[Mapping[str, OptionRoot]] = {
        "mapping": OptionRoot(
            "HierarchicalPipelineOptions",
            "mapping",
            {
                (): "hierarchical",
                ("clustering_options",): "clustering",
                ("incremental_options",): "pipeline",
                ("incremental_options", "mapper"): "mapper",
                ("incremental_options", "triangulation"): "triangulation",
            },
        )
    }

    def map(self, staged: StagedRun) -> list[Any]:
        """Return the models that hierarchical mapping finds."""
        options = staged.options["mapping"]
        options.incremental_options.extract_colors = False
        with staged.opened(staged.geometry()) as database:
            return run_to_models(lambda manager: pycolmap.HierarchicalPipeline(options, database, manager))


def create(settings: Mapping[str, object]) -> ColmapPipeline:
    """Return the pipeline ``colmap``."""
    return ColmapPipeline("colmap", pycolmap_version(), settings_of("colmap", settings))


def create_hierarchical(settings: Mapping[str, object]) -> HierarchicalPipeline:
    """Return the pipeline ``colmap-hierarchical``."""
    return HierarchicalPipeline("colmap-hierarchical", pycolmap_version(), settings_of("colmap-hierarchical", settings))
