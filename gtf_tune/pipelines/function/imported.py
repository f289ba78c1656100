"""Pipelines by the name ``module:attribute``: a pipeline, a factory of pipelines, or a plain function."""

import inspect
import json
import os
import sys
from collections.abc import Mapping
from functools import cached_property, reduce
from pathlib import Path
from typing import Any, Literal, cast

from gtf_tune.definition.objects import load_object
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines.base import Pipeline, PipelineJob, PipelineOutput
from gtf_tune.pipelines.function.pipeline import described, of_module
from gtf_tune.pipelines.options import OptionTable

_FUNCTION_SETTINGS = frozenset({"nominal", "version"})
_PARTS = ("name", "version", "settings", "options", "run")


class ImportedPipeline:
    """A pipeline that each process imports anew by its name.

    Parameters
    ----------
    target
        ``module:attribute``.
    settings
        Those of the definition.
    folder
        Where the module is looked for after the usual places.
    """

    def __init__(self, target: str, settings: Mapping[str, object], folder: str) -> None:
        self._given = target, dict(settings), folder

    def __reduce__(self) -> tuple[type["ImportedPipeline"], tuple[str, dict[str, object], str]]:
        return ImportedPipeline, self._given

    @cached_property
    def _pipeline(self) -> Pipeline:
        target, settings, folder = self._given
        return _made(target, settings, folder)

    @property
    def name(self) -> str:
        """Return the name of the pipeline, for a function ``module:attribute``."""
        return self._pipeline.name

    @property
    def version(self) -> str:
        """Return the version of the pipeline."""
        return self._pipeline.version

    @property
    def settings(self) -> Mapping[str, str]:
        """Return the settings of the pipeline."""
        return self._pipeline.settings

    @property
    def reads_times(self) -> bool:
        """Whether results depend on the times of frames."""
        return bool(getattr(self._pipeline, "reads_times", False))

    @property
    def channels(self) -> Literal[1, 3]:
        """Return 3 where the pipeline reads colour images, 1 where it reads grey ones."""
        return 3 if getattr(self._pipeline, "channels", 1) == 3 else 1

    @property
    def options(self) -> OptionTable:
        """Return the options of the pipeline."""
        return self._pipeline.options

    def run(self, job: PipelineJob) -> PipelineOutput:
        """Return what the pipeline returns."""
        return self._pipeline.run(job)


def create_imported(target: str, settings: Mapping[str, object]) -> Pipeline:
    """Return the pipeline that ``module:attribute`` names; the module is looked for in the current folder last.

    The attribute is a pipeline, a factory that makes one from settings, or a plain function ``f(images, options,
    seed)`` whose defaults are its attribute ``nominal`` or the setting ``nominal``. The version of a plain function is
    the setting ``version``, else the SHA-256 of its module's file: other modules that it uses are not covered. A
    function of a script or notebook cannot be imported: its options are known from the setting ``nominal``, but it
    cannot run.

    Raises
    ------
    DefinitionError
        The module or the attribute is missing, or is no pipeline.
    """
    if not is_importable(target):
        return described(target, settings)
    pipeline = ImportedPipeline(target, settings, os.getcwd())
    _ = pipeline.name  # what is wrong shows now
    return cast(Pipeline, pipeline)


def is_importable(target: str) -> bool:
    """Whether another process can have what ``module:attribute`` names: not that of a main script or a function."""
    module, _, attribute = target.partition(":")
    return module != "__main__" and "<" not in attribute


def resolved(target: str) -> object:
    """Return what ``module:attribute`` names in this process, ``None`` where it names nothing."""
    module, _, attribute = target.partition(":")
    try:
        found: object = reduce(getattr, attribute.split("."), sys.modules[module])
    except (KeyError, AttributeError):
        return None
    return found


def needs_nominal(target: str) -> bool:
    """Whether ``module:attribute`` names a plain function that does not bring the defaults of its options.

    Raises
    ------
    DefinitionError
        The module or the attribute is missing.
    """
    if not is_importable(target):
        return True
    found, _ = _load(target, os.getcwd())
    return _is_function(found) and not hasattr(found, "nominal")


def _made(target: str, settings: Mapping[str, object], folder: str) -> Pipeline:
    found, source = _load(target, folder)
    if _is_pipeline(found):
        _refuse(target, settings, frozenset())
        return cast(Pipeline, found)
    if not callable(found):
        raise DefinitionError(f"'{target}' is neither a pipeline nor a function, but {type(found).__name__}")
    if "nominal" in settings or _is_function(found):
        _refuse(target, settings, _FUNCTION_SETTINGS)
        return of_module(target, found, settings, source)
    made = found(settings)
    if not _is_pipeline(made):
        raise DefinitionError(
            f"'{target}' returned {type(made).__name__} for its settings, which is no pipeline; a function of images, "
            "options and seed needs its defaults as its attribute 'nominal' or as the setting 'nominal'"
        )
    return cast(Pipeline, made)


def _load(target: str, folder: str) -> tuple[Any, bytes]:
    """Return the attribute and the bytes of its module's file."""
    found = load_object(target, "pipeline", folder)
    file = getattr(sys.modules[target.partition(":")[0]], "__file__", None)
    return found, Path(file).read_bytes() if file else b""


def _is_pipeline(found: object) -> bool:
    return not inspect.isclass(found) and all(hasattr(found, part) for part in _PARTS)


def _is_function(found: object) -> bool:
    """Whether this is a plain function of images, options and seed, not a pipeline or a factory of one."""
    if _is_pipeline(found) or not callable(found):
        return False
    return hasattr(found, "nominal") or _arguments(found) >= len(("images", "options", "seed"))


def _arguments(function: Any) -> int:
    """Return how many arguments a callable insists on; one for a factory."""
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return 1
    positional = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    required = [parameter for parameter in parameters if parameter.default is inspect.Parameter.empty]
    return sum(parameter.kind in positional for parameter in required)


def _refuse(target: str, settings: Mapping[str, object], known: frozenset[str]) -> None:
    unknown = sorted(set(settings) - known)
    if unknown:
        has = f"only {' and '.join(sorted(known))}" if known else "none"
        raise DefinitionError(f"pipeline '{target}': unknown settings {json.dumps(unknown)}; it has {has}")
