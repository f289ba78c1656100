"""Find pipelines by name: the built-in ones, those that other packages install, and those of any module."""

from collections.abc import Callable, Mapping
from functools import partial
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from types import MappingProxyType
from typing import cast

from gtf_tune.errors import DefinitionError, did_you_mean
from gtf_tune.pipelines.base import Pipeline

PipelineFactory = Callable[[Mapping[str, object]], Pipeline]
"""Make a pipeline from its settings; raise `DefinitionError` where they are wrong."""

ENTRY_POINT_GROUP = "gtf_tune.pipelines"
"""Group of entry points in which other packages offer a `PipelineFactory` under the pipeline's name."""

_BUILT_IN = MappingProxyType(
    {
        "analytic": "gtf_tune.pipelines.analytic:create",
        "colmap": "gtf_tune.pipelines.colmap.incremental:create",
        "colmap-hierarchical": "gtf_tune.pipelines.colmap.incremental:create_hierarchical",
        "command": "gtf_tune.pipelines.command:create",
        "droid-slam": "gtf_tune.pipelines.droid_slam:create",
        "glomap": "gtf_tune.pipelines.colmap.glomap:create",
    }
)
_NO_SETTINGS: Mapping[str, object] = MappingProxyType({})


def pipeline_names() -> tuple[str, ...]:
    """Return the names of all pipelines that can be created here, sorted."""
    return tuple(sorted({*_BUILT_IN, *_installed()}))


def create_pipeline(name: str, settings: Mapping[str, object] = _NO_SETTINGS) -> Pipeline:
    """Return the pipeline of that name, or that ``module:attribute`` names; its module is imported now and not before.

    Raises
    ------
    DefinitionError
        No pipeline has this name, its package cannot be imported, or a setting is wrong.
    """
    return _factory(name)(settings)


def _factory(name: str) -> PipelineFactory:
    if name in _BUILT_IN:
        module, _, attribute = _BUILT_IN[name].partition(":")
        return cast(PipelineFactory, getattr(import_module(module), attribute))
    if ":" in name:
        from gtf_tune.pipelines.function import create_imported

        return partial(create_imported, name)
    found = _installed().get(name)
    if found is None:
        raise DefinitionError(_unknown(name), remedy=("pipelines",))
    try:
        return cast(PipelineFactory, found.load())
    except (ImportError, AttributeError) as error:
        raise DefinitionError(
            f"pipeline '{name}' is offered by {found.value} but cannot be imported ({error}); reinstall it"
        ) from error


def _installed() -> dict[str, EntryPoint]:
    return {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP) if point.name not in _BUILT_IN}


def _unknown(name: str) -> str:
    names = pipeline_names()
    hint = did_you_mean(name, names, cutoff=0.5, otherwise=f"is it one of {', '.join(names)}?")
    return f"unknown pipeline '{name}'; {hint}"
