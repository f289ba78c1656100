"""Write what a program reads: images, lists, camera, settings files; and give its placeholders their values."""

import statistics
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

from gtf_tune.errors import DefinitionError, RunError
from gtf_tune.pipelines.base import PipelineJob
from gtf_tune.pipelines.command.camera import camera_values
from gtf_tune.pipelines.command.definition import CommandDefinition, FileDefinition, ImagesDefinition, Scalar
from gtf_tune.pipelines.command.resolution import ResolvedCommand
from gtf_tune.pipelines.command.sequence_folder import uses_sequence, write_image, write_sequence
from gtf_tune.pipelines.command.settings_files import format_of, write_values
from gtf_tune.pipelines.command.templates import NoValueError, Value, filled
from gtf_tune.pipelines.options import OptionValue
from gtf_tune.pipelines.run import digest
from gtf_tune.sequence import Frame

_NANOSECONDS = 10**9
_PLAIN = ImagesDefinition()


@dataclass(frozen=True)
class RunInputs:
    """What was prepared for one run: the placeholders' values, the images' names, and all option values.

    ``cameras`` are the values of the placeholders of each camera, where there are several.
    """

    values: Mapping[str, Value]
    names: tuple[str, ...]
    options: Mapping[str, OptionValue]
    cameras: tuple[Mapping[str, Value], ...] = ()


def prepare(command: ResolvedCommand, job: PipelineJob) -> RunInputs:
    """Write all inputs of a run below its workspace and return them.

    Raises
    ------
    RunError
        A placeholder has no value, or a settings file cannot take a value.
    """
    definition = command.definition
    options = {name: option.default for name, option in definition.options.items()} | dict(job.options)
    workspace = job.workspace / "work"
    workspace.mkdir()
    for folder in definition.folders:
        (workspace / folder).mkdir(parents=True, exist_ok=True)
    names = image_names(definition.images, job)
    values = _values(command, job, workspace, options)
    _link(workspace / definition.images.folder, _images(definition.images, job, names))
    if uses_sequence(definition):
        write_sequence(definition, job, workspace / "sequence")
    _write_lists(job, names, values)
    for file in definition.files:
        if _write_file(file, job, workspace, names, values, definition.boolean_words):
            values[f"file:{file.path}"] = workspace / file.path
    _write_settings_files(definition, values, options)
    return RunInputs(values, names, options, _cameras(job, names))


def image_names(images: ImagesDefinition, job: PipelineJob) -> tuple[str, ...]:
    """Return the file name of each frame, in order.

    Raises
    ------
    RunError
        Two frames have one name.
    """
    frames = job.images.sequence.frames
    names = tuple(filled(images.name, _frame_values(index, frame)) for index, frame in enumerate(frames))
    if len(set(names)) < len(names):
        raise RunError(f"two frames of the sequence have the same image name by '{images.name}'; take another pattern")
    return names


def _frame_values(index: int, frame: Frame, name: str = "") -> dict[str, Value]:
    values: dict[str, Value] = {
        "index": index,
        "frame_id": frame.frame_id,
        "timestamp_s": frame.timestamp,
        "timestamp_ns": round(frame.timestamp * _NANOSECONDS),
    }
    return values | {"name": name} if name else values


def _values(
    command: ResolvedCommand, job: PipelineJob, workspace: Path, options: Mapping[str, OptionValue]
) -> dict[str, Value]:
    definition, sequence = command.definition, job.images.sequence
    inputs = job.workspace / "inputs"
    values: dict[str, Value] = {
        "sequence": workspace / "sequence",
        **command.parameters,
        **{f"option:{name}": value for name, value in options.items()},
        "workspace": workspace,
        "images": workspace / definition.images.folder,
        "image_list": inputs / "image_list.txt",
        "timestamps": inputs / "timestamps.txt",
        "output": workspace / definition.output.path,
        "seed": job.seed,
        "threads": job.threads,
        "num_images": len(sequence),
        "width": sequence.width,
        "height": sequence.height,
    }
    if sequence.has_timestamps and len(sequence) > 1:
        times = [frame.timestamp for frame in sequence.frames]
        values["fps"] = 1 / statistics.median(after - before for before, after in pairwise(times))
    if job.camera:
        values |= camera_values(job.camera)
        values["camera"] = inputs / "cameras.txt"
    for file in definition.settings_files:
        path = workspace / (file.path or Path(filled(file.template, values)).name)
        values[f"settings_file:{file.name}"] = path
        values["settings_file"] = path
    return values


def _images(images: ImagesDefinition, job: PipelineJob, names: tuple[str, ...]) -> Path:
    if images.name == _PLAIN.name:
        return job.stages.reach("images", job.images.key, job.images.write)
    key = digest({"images": job.images.key, "name": images.name})
    return job.stages.reach("images", key, lambda folder: _write_images(folder, job, names))


def _write_images(folder: Path, job: PipelineJob, names: tuple[str, ...]) -> None:
    for name, frame in zip(names, job.images.sequence.frames, strict=True):
        write_image(folder / name, job.images.read(frame))


def _link(link: Path, target: Path) -> None:
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(target)


def _write_lists(job: PipelineJob, names: tuple[str, ...], values: Mapping[str, Value]) -> None:
    inputs = job.workspace / "inputs"
    inputs.mkdir()
    times = [repr(frame.timestamp) for frame in job.images.sequence.frames]
    (inputs / "image_list.txt").write_text("\n".join(names) + "\n", encoding="utf-8", errors="surrogateescape")
    (inputs / "timestamps.txt").write_text("\n".join(times) + "\n", encoding="utf-8")
    if job.camera:
        params = " ".join(repr(value) for value in job.camera.params)
        line = f"1 {job.camera.model} {job.camera.width} {job.camera.height} {params}\n"
        Path(str(values["camera"])).write_text(line, encoding="utf-8")


def _cameras(job: PipelineJob, names: tuple[str, ...]) -> tuple[Mapping[str, Value], ...]:
    """Write the list of each camera's images, and return the placeholders of each; nothing for a single camera."""
    sequence, found = job.images.sequence, []
    if len(sequence.cameras) == 1:
        return ()
    for number, camera in enumerate(sequence.cameras):
        path = job.workspace / "inputs" / f"images_of_camera_{number + 1}.txt"
        listed = [name for name, taken_by in zip(names, sequence.taken_by, strict=True) if taken_by == number]
        path.write_text("\n".join(listed) + "\n", encoding="utf-8", errors="surrogateescape")
        values: dict[str, Value] = {"camera_image_list": path, "width": camera.width, "height": camera.height}
        found.append(values | (camera_values(camera.intrinsics) if camera.intrinsics else {}))
    return tuple(found)


def _write_file(
    file: FileDefinition,
    job: PipelineJob,
    workspace: Path,
    names: tuple[str, ...],
    values: Mapping[str, Value],
    boolean_words: tuple[str, str],
) -> bool:
    """Write a file, and return whether it was written: an optional one may lack a value."""
    path = workspace / file.path
    try:
        if file.link:
            _link(path, Path(filled(file.link, values, boolean_words)))
            return True
        text = filled(file.text, values, boolean_words)
        for index, (frame, name) in enumerate(zip(job.images.sequence.frames, names, strict=True)):
            if file.each_frame:
                of_frame = {**values, **_frame_values(index, frame, name)}
                text += filled(file.each_frame, of_frame, boolean_words) + "\n"
    except NoValueError:
        if file.optional:
            return False
        raise
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("".join(f"{line.rstrip(' ')}\n" for line in text.splitlines()), "utf-8", "surrogateescape")
    return True


def _write_settings_files(
    definition: CommandDefinition, values: Mapping[str, Value], options: Mapping[str, OptionValue]
) -> None:
    for file in definition.settings_files:
        template = Path(filled(file.template, values))
        form = file.format or format_of(template)
        wanted: dict[str, Scalar] = {}
        for key, setting in file.values.items():
            try:
                wanted[key] = _scalar(filled(setting, values)) if isinstance(setting, str) else setting
            except NoValueError:
                continue
        for name, option in definition.options.items():
            passed = definition.options_passed == "all" or options[name] != option.default
            if option.key and passed and option.file in ("", file.name):
                value = options[name]
                spelt = form == "ini" and isinstance(value, bool)
                wanted[option.key] = definition.boolean_words[int(value)] if spelt else value
        path = Path(str(values[f"settings_file:{file.name}"]))
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            text = template.read_bytes().decode("utf-8", "surrogateescape")  # with its own ends of lines
            edited = write_values(text, form, wanted, file.add_missing)
        except (OSError, DefinitionError) as error:
            raise RunError(f"{template} cannot be used as settings file: {error}") from error
        path.write_bytes(edited.encode("utf-8", "surrogateescape"))


def _scalar(text: str) -> Scalar:
    """Return the number that a text is, or the text."""
    kinds: tuple[Any, ...] = (int, float)
    for kind in kinds:
        try:
            value: Scalar = kind(text)
        except ValueError:
            continue
        return value
    return text
