"""Run a Python function as a pipeline, in child processes like every other pipeline."""

import hashlib
import inspect
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import CodeType
from typing import Any

import cloudpickle

from gtf_tune.errors import DefinitionError, RunError
from gtf_tune.pipelines.base import PipelineJob, PipelineOutput
from gtf_tune.pipelines.function.images import RunImages
from gtf_tune.pipelines.function.output import trajectory_of
from gtf_tune.pipelines.options import OptionSpec, OptionTable, OptionValue

SlamFunction = Callable[[RunImages, dict[str, OptionValue], int], object]
"""``f(images, options, seed)``: returns a trajectory, (positions, quaternions), or the path of a trajectory file."""

_KINDS = "true or false, a whole number, a number or a text"


@dataclass
class FunctionPipeline:
    """A Python function as a pipeline.

    Attributes
    ----------
    name
        ``module:qualified name`` of the function.
    version
        What distinguishes the results of one state of the function from those of another.
    settings
        ``nominal`` as JSON: run keys hold the options that differ from it.
    nominal
        Name and default of every option.
    function
        The function itself, where its processes can import it; else ``None``.
    packed
        The function by value (cloudpickle); empty where processes can import it, and where it is not at hand.
    """

    name: str
    version: str
    settings: Mapping[str, str]
    nominal: Mapping[str, OptionValue]
    function: SlamFunction | None = None
    packed: bytes = b""

    reads_times = True

    @property
    def options(self) -> OptionTable:
        """Return the options that ``nominal`` names, of the types that their defaults have."""
        return OptionTable(self.name, {name: OptionSpec(name, value) for name, value in self.nominal.items()})

    @property
    def unavailable(self) -> str:
        """Return why the function cannot run in this process, empty where it can."""
        if self.packed or self.function:
            return ""
        name = self.name.partition(":")[2]
        return (
            f"tunes the Python function '{name}' of a script or notebook, which only that program has; go on there "
            f"with gtf_tune.open_study(..., pipeline={name})"
        )

    def run(self, job: PipelineJob) -> PipelineOutput:
        """Return the trajectory that the function finds.

        Raises
        ------
        RunError
            The function is not at hand, or what it returned is no trajectory of the images.
        """
        function = cloudpickle.loads(self.packed) if self.packed else self.function
        if function is None:
            raise RunError(f"the function of pipeline '{self.name}' is not at hand in this process")
        images = RunImages(job)
        trajectory = trajectory_of(function(images, {**self.nominal, **job.options}, job.seed), images)
        return PipelineOutput(trajectory, {"num_poses": len(trajectory)})


def from_function(function: SlamFunction, nominal: object, version: str = "") -> FunctionPipeline:
    """Return the pipeline of a function that travels to its processes by value.

    Raises
    ------
    DefinitionError
        The function cannot be pickled, ``nominal`` is missing or wrong, or there is neither a version nor a source.
    """
    name = name_of(function)
    try:
        packed = cloudpickle.dumps(function)
    except Exception as error:  # pickling runs code of any type that the function refers to
        raise DefinitionError(
            f"function '{name}' cannot be sent to other processes ({error}); create what it needs inside of it instead "
            "of taking it from outside"
        ) from error
    defaults = checked_nominal(name, nominal)
    return FunctionPipeline(name, version or source_version(function), _settings(defaults), defaults, packed=packed)


def name_of(function: object) -> str:
    """Return ``module:qualified name`` of a callable, of its type where it has no name."""
    named = function if hasattr(function, "__qualname__") else type(function)
    return f"{getattr(named, '__module__', '__main__')}:{getattr(named, '__qualname__', 'function')}"


def checked_nominal(name: str, nominal: object) -> dict[str, OptionValue]:
    """Return the defaults of the options of a function, sorted by name.

    Raises
    ------
    DefinitionError
        There are none, or one is no option value.
    """
    if not isinstance(nominal, Mapping) or not nominal:
        raise DefinitionError(
            f"function '{name}' needs the defaults of its options; give nominal={{'NAME': VALUE, ...}} or set them as "
            "its attribute 'nominal'"
        )
    return {str(option): _default(name, str(option), value) for option, value in sorted(nominal.items())}


def described(name: str, settings: Mapping[str, object]) -> FunctionPipeline:
    """Return the pipeline of a function that is not at hand: its options are known, but it cannot run.

    Raises
    ------
    DefinitionError
        ``settings`` lack ``nominal``.
    """
    defaults = checked_nominal(name, settings.get("nominal"))
    return FunctionPipeline(name, str(settings.get("version", "")), _settings(defaults), defaults)


def of_module(name: str, function: SlamFunction, settings: Mapping[str, object], source: bytes) -> FunctionPipeline:
    """Return the pipeline of a function that every process can import; ``source`` is that of its module.

    Raises
    ------
    DefinitionError
        Neither ``settings`` nor the function has ``nominal``.
    """
    defaults = checked_nominal(name, settings.get("nominal", getattr(function, "nominal", None)))
    version = str(settings.get("version", "")) or hashlib.sha256(source).hexdigest()
    return FunctionPipeline(name, version, _settings(defaults), defaults, function)


def source_version(function: object) -> str:
    """Return the SHA-256 of a function's source, or of its code where it was typed at a prompt.

    Raises
    ------
    DefinitionError
        It has neither.
    """
    plain: Any = inspect.unwrap(function) if callable(function) else function
    try:
        source = inspect.getsource(plain if hasattr(plain, "__code__") or inspect.isclass(plain) else type(plain))
    except (OSError, TypeError) as error:
        code = getattr(plain, "__code__", None)
        if code is None:
            raise DefinitionError(
                f"the source of '{name_of(function)}' cannot be read, so nothing says when its results change; give "
                "version='1', and another one whenever it changes"
            ) from error
        source = repr(_code_parts(code))
    return hashlib.sha256(source.encode()).hexdigest()


def _code_parts(code: CodeType) -> tuple[object, ...]:
    constants = [_code_parts(part) if isinstance(part, CodeType) else part for part in code.co_consts]
    return code.co_code, code.co_names, code.co_varnames, constants


def _settings(defaults: Mapping[str, OptionValue]) -> dict[str, str]:
    return {"nominal": json.dumps(defaults, sort_keys=True)}


def _default(function: str, option: str, value: object) -> OptionValue:
    if hasattr(value, "item") and not getattr(value, "shape", ()):  # a number of numpy's
        value = value.item()
    if isinstance(value, bool | int | str) or (isinstance(value, float) and math.isfinite(value)):
        return value
    raise DefinitionError(f"function '{function}': the default of option '{option}' must be {_KINDS}, not {value!r}")
