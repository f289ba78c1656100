"""Define how a program is run: the tables that a preset, a definition file or a study's settings may have."""

from collections.abc import Iterator
from typing import Literal, Self

from pydantic import Field, field_validator, model_validator

from gtf_tune.definition.base import Section
from gtf_tune.pipelines.command.camera import DISTORTION
from gtf_tune.pipelines.command.settings_files import FORMATS
from gtf_tune.pipelines.options import OptionSpec

Scalar = bool | int | float | str
Arguments = tuple[str | tuple[str, ...], ...]
"""Words of a command; a list among them is a group that is left out where one of its placeholders has no value."""

CAMERA_FIELDS = frozenset(
    {"camera", "camera_image_list", "camera_model", "camera_params", "camera_distortion"}
    | {f"camera_{name}" for name in ("fx", "fy", "cx", "cy", *DISTORTION)}
)
RUN_FIELDS = CAMERA_FIELDS | {
    "images",
    "image_list",
    "timestamps",
    "output",
    "sequence",
    "seed",
    "threads",
    "workspace",
    "state",
    "settings_file",
    "file",
    "options",
    "option",
    "num_images",
    "width",
    "height",
    "fps",
}
"""Placeholders that every run has; `docs/pipelines.md` says what they stand for."""

FRAME_FIELDS = frozenset({"index", "frame_id", "name", "timestamp_s", "timestamp_ns"})
"""Placeholders that each frame has besides."""

OPTION_FIELDS = frozenset({"name", "value"})
"""Placeholders that the words of an option have besides."""

TIME_FIELDS = frozenset({"timestamps", "fps", "timestamp_s", "timestamp_ns"})
"""Placeholders that stand for times of frames."""


class ParameterDefinition(Section):
    """Name something that the user gives: where a program, a file or a folder is, or a word for the command.

    Results depend on the contents of a ``file`` and on a ``text``; not on where an ``executable`` or ``folder`` lies
    (``version_command`` covers those). Without a default it must be given.
    """

    kind: Literal["executable", "file", "folder", "text", "arguments"] = "text"
    default: str | tuple[str, ...] | None = None
    choices: tuple[str, ...] = ()
    documentation: str = ""


class OptionDefinition(Section):
    """Describe a tunable option and how the program learns of it.

    It is one of the ``{options}`` of its step (of all steps where ``step`` is empty), as ``arguments`` or the
    definition's ``option_arguments`` say; or it is named as ``{option:NAME}``; or it is written to ``key`` of the
    settings file ``file``, and what that file holds there is then the default. For true or false, ``arguments`` stand
    for true and ``arguments_if_false`` for false.
    """

    default: Scalar
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    documentation: str = ""
    step: str = ""
    arguments: tuple[str, ...] | None = None
    arguments_if_false: tuple[str, ...] = ()
    key: str = ""
    file: str = ""


class StepDefinition(Section):
    """Describe one program of several; a ``cached`` step leaves all that later steps need in ``{state}``.

    A step with ``each_camera`` is run once for each camera of a sequence that has several, with these arguments added;
    ``{camera_image_list}`` and the other placeholders of the camera are then those of that camera.
    """

    name: str
    arguments: Arguments
    cached: bool = False
    each_camera: Arguments = ()


class ImagesDefinition(Section):
    """Say where in the workspace the images lie and what they are called; the suffix gives the format.

    They are grey, or in colour where ``channels`` is 3: each channel has noise of its own then.
    """

    folder: str = "images"
    name: str = "{frame_id:06d}.pgm"
    channels: Literal[1, 3] = 1

    @model_validator(mode="after")
    def _check_colour(self) -> Self:
        if self.channels == 3 and self.name.endswith(".pgm"):
            raise ValueError("a PGM file has no colour; with channels = 3 give a 'name' such as '{frame_id:06d}.png'")
        return self


class SequenceFilesDefinition(Section):
    """Say what the folder ``{sequence}`` has besides the images of the frames, by paths below the data set's folder.

    Files and folders that are ``unchanged`` (depth, an IMU's data, lists) are links to the data set's; the images of
    ``noisy`` ones (those of a second camera) get the same amount of noise as the frames, drawn by itself.
    """

    unchanged: tuple[str, ...] = ()
    noisy: tuple[str, ...] = ()


class FileDefinition(Section):
    """Describe a file that is written before the program starts: fixed text, then one line for each frame.

    ``link`` makes it a symbolic link instead, to a file or folder that the program looks for in its working folder. An
    ``optional`` file is left out where one of its placeholders has no value, and ``{file:PATH}`` then has none either.
    """

    path: str
    text: str = ""
    each_frame: str = ""
    link: str = ""
    optional: bool = False


class SettingsFileDefinition(Section):
    """Describe a copy of a settings file into which options and other values are written by dotted path.

    ``values`` whose placeholders have no value (a camera that nobody knows) stay as they are in the template. A file
    that only one ``step`` reads may hold options of that step, so that a cached one depends on its own options alone.
    """

    name: str = "settings"
    template: str
    format: str = ""
    path: str = ""
    step: str = ""
    values: dict[str, Scalar] = Field(default_factory=dict)
    add_missing: bool = False

    @field_validator("format")
    @classmethod
    def _check_format(cls, value: str) -> str:
        if value and value not in FORMATS:
            raise ValueError(f"should be one of {', '.join(FORMATS)}")
        return value


_NAMED = ("colmap", "transforms", "opensfm", "sfmdata")
"""Formats that name the images."""


class OutputDefinition(Section):
    """Where the trajectory is, in which format, and how its poses belong to the frames.

    ``index`` takes the time column for the position in the list of images, ``row`` the n-th pose for the n-th image.
    TUM's times are multiplied by ``time_scale``; where that is 1, they are in the unit that the header names, seconds
    otherwise. ``sort`` puts TUM's and EuRoC's poses in the order of time.
    ``duplicates`` says which of several poses of one image counts: programs that lose track may repeat their last pose.
    A COLMAP folder and an OpenSfM file may hold several models: the largest counts.
    """

    path: str = "output"
    format: Literal["tum", "kitti", "euroc", "colmap", "transforms", "opensfm", "sfmdata"] = "tum"
    association: Literal["name", "timestamp", "index", "row"] = "timestamp"
    delimiter: Literal[" ", ","] = " "
    time_scale: float = Field(default=1.0, gt=0)
    sort: bool = False
    duplicates: Literal["error", "first", "last"] = "error"
    max_difference_s: float = Field(default=1e-3, gt=0)
    poses: Literal["world_from_camera", "camera_from_world"] = "world_from_camera"

    @model_validator(mode="after")
    def _check_together(self) -> Self:
        if (self.format in _NAMED) != (self.association == "name"):
            raise ValueError(f"poses are associated by 'name' in the formats {', '.join(_NAMED)} and there only")
        if self.format == "kitti" and self.association != "row":
            raise ValueError("the format 'kitti' has no times; its association is 'row'")
        if self.format != "tum" and (self.time_scale != 1.0 or self.delimiter != " "):
            raise ValueError("'time_scale' and 'delimiter' are for the format 'tum' only")
        if self.sort and self.format not in ("tum", "euroc"):
            raise ValueError(f"the format '{self.format}' has no times to 'sort' by")
        if self.duplicates != "error" and self.association not in ("timestamp", "index"):
            raise ValueError("'duplicates' needs poses that are associated by 'timestamp' or 'index'")
        return self


class CommandDefinition(Section):
    """Define a program as a pipeline; `docs/pipelines.md` is the reference.

    With ``gpu`` one run at a time uses a CUDA device.
    """

    description: str = ""
    sources: tuple[str, ...] = ()
    parameters: dict[str, ParameterDefinition] = Field(default_factory=dict)
    arguments: Arguments = ()
    steps: tuple[StepDefinition, ...] = ()
    options: dict[str, OptionDefinition] = Field(default_factory=dict)
    option_arguments: tuple[str, ...] = ("--{name}", "{value}")
    options_passed: Literal["changed", "all"] = "changed"
    boolean_words: tuple[str, str] = ("false", "true")
    images: ImagesDefinition = ImagesDefinition()
    sequence_files: SequenceFilesDefinition = SequenceFilesDefinition()
    folders: tuple[str, ...] = ()
    files: tuple[FileDefinition, ...] = ()
    settings_files: tuple[SettingsFileDefinition, ...] = ()
    environment: dict[str, str] = Field(default_factory=dict)
    working_folder: str = "{workspace}"
    exit_codes: tuple[int, ...] = (0,)
    gpu: bool = False
    output: OutputDefinition = OutputDefinition()
    version_command: tuple[str, ...] = ()
    version_pattern: str = ""

    @property
    def all_steps(self) -> tuple[StepDefinition, ...]:
        """Return the steps; a definition with ``arguments`` has one, called ``run``."""
        return self.steps or (StepDefinition(name="run", arguments=self.arguments),)

    def option_specs(self) -> dict[str, OptionSpec]:
        """Return the options in the form in which every pipeline describes its own."""
        return {
            name: OptionSpec(
                name,
                option.default,
                option.documentation,
                option.choices,
                option.step,
                option.low,
                option.high,
            )
            for name, option in self.options.items()
        }


def templates_of(definition: CommandDefinition) -> Iterator[tuple[str, str, frozenset[str]]]:
    """Yield where each template stands, the template, and the placeholders it may have besides those of every run."""
    none: frozenset[str] = frozenset()
    for step in definition.all_steps:
        for word in words_of((*step.arguments, *step.each_camera)):
            yield f"step '{step.name}'", word, none
    for file in definition.files:
        yield f"file '{file.path}'", file.text, none
        yield f"file '{file.path}'", file.each_frame, FRAME_FIELDS
        yield f"file '{file.path}'", file.link, none
    for settings_file in definition.settings_files:
        yield f"settings file '{settings_file.name}'", settings_file.template, none
        for key, value in settings_file.values.items():
            yield f"'{key}' of settings file '{settings_file.name}'", str(value), none
    for name, value in definition.environment.items():
        yield f"environment variable '{name}'", value, none
    yield "working_folder", definition.working_folder, none
    yield "images.name", definition.images.name, FRAME_FIELDS - {"name"}
    for word in definition.version_command:
        yield "version_command", word, none


def option_templates_of(definition: CommandDefinition) -> Iterator[tuple[str, str, frozenset[str]]]:
    """Yield the templates of the words that options become, in the form of `templates_of`."""
    for word in definition.option_arguments:
        yield "option_arguments", word, OPTION_FIELDS
    for name, option in definition.options.items():
        for word in (*(option.arguments or ()), *option.arguments_if_false):
            yield f"option '{name}'", word, OPTION_FIELDS


def words_of(arguments: Arguments) -> Iterator[str]:
    """Yield every word of a command, those of optional groups included."""
    for argument in arguments:
        yield from [argument] if isinstance(argument, str) else argument
