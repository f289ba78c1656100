"""Give programs the folder of the data set with its images replaced by the clean or noisy ones: ``{sequence}``."""

import os
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path, PurePosixPath

import cv2

from gtf_tune.errors import MachineError, RunError
from gtf_tune.pipelines.base import PipelineJob
from gtf_tune.pipelines.command.definition import CommandDefinition, SequenceFilesDefinition, templates_of
from gtf_tune.pipelines.command.templates import fields_of
from gtf_tune.pipelines.file_digest import file_digest
from gtf_tune.pipelines.run import digest
from gtf_tune.sequence import Sequence
from gtf_tune.sequence.image_noise import noisy_image
from gtf_tune.sequence.images import read_colour, read_grey

_FOLDER_STRIDE = 1 << 40
"""Added to the position of an image for each folder that gets noise, so that no two images have the same noise."""


def uses_sequence(definition: CommandDefinition) -> bool:
    """Return whether a program is given the data set's folder; a parameter of that name is the user's own."""
    if "sequence" in definition.parameters:
        return False
    return any(name == "sequence" for _, template, _ in templates_of(definition) for name, _ in fields_of(template))


def sequence_key(definition: CommandDefinition, sequence: Sequence) -> str | None:
    """Return the digest of what ``{sequence}`` has besides the pixels of the frames; ``None`` where nobody reads it.

    Raises
    ------
    RunError
        Something that the definition names is not in the data set.
    """
    if not uses_sequence(definition):
        return None
    names = definition.sequence_files
    listed = {name: _digest_of(_found(sequence, name)) for name in (*names.unchanged, *names.noisy)}
    return digest({"frames": [_place(sequence, frame.path) for frame in sequence.frames], "files": listed})


def write_sequence(definition: CommandDefinition, job: PipelineJob, folder: Path) -> None:
    """Make a folder like the data set's: its images as the run sees them, and what the definition names besides.

    Raises
    ------
    RunError
        Images were resized, which other files do not know, or something named is missing or holds replaced images.
    MachineError
        The folder cannot be written to.
    """
    sequence, names = job.images.sequence, definition.sequence_files
    if any(camera.size != camera.stored_size for camera in sequence.cameras):
        raise RunError("{sequence} has the files of the data set, which do not fit resized images; omit max_image_size")
    key = digest({"sequence": job.images.key, "files": sequence_key(definition, sequence)})
    images = job.stages.reach("sequence", key, lambda target: _write_images(names, job, target))
    for path in sorted(path for path in images.rglob("*") if path.is_file()):
        _link(folder / path.relative_to(images), path)
    for name in names.unchanged:
        _link(folder / name, _found(sequence, name))


def _write_images(names: SequenceFilesDefinition, job: PipelineJob, target: Path) -> None:
    source = job.images
    for frame in source.sequence.frames:
        write_image(target / _place(source.sequence, frame.path), source.read(frame))
    read = read_grey if source.channels == 1 else read_colour
    for number, name in enumerate(names.noisy, 1):
        for position, path in enumerate(_files_in(_found(source.sequence, name))):
            place = target / _place(source.sequence, path)
            pixels = noisy_image(
                read(path), source.sigma, seed=source.seed, frame_id=number * _FOLDER_STRIDE + position
            )
            write_image(place, pixels)


def write_image(path: Path, pixels: "cv2.typing.MatLike") -> None:
    """Write an image in the format that its name ends in; not by OpenCV, which crashes over names that are no UTF-8.

    Raises
    ------
    RunError
        OpenCV cannot write that format.
    MachineError
        The disk is full or the folder cannot be written to.
    """
    try:
        coded, data = cv2.imencode(path.suffix, pixels)
    except cv2.error as error:
        raise RunError(f"{path.name}: images of this format cannot be written; convert them to PNG") from error
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data.tobytes() if coded else b"")
    except OSError as error:
        raise MachineError(
            f"{path}: cannot write the image ({error.strerror}); make room or choose another folder for the cache"
        ) from error


def _link(link: Path, target: Path) -> None:
    link.parent.mkdir(parents=True, exist_ok=True)
    try:
        link.symlink_to(target)
    except FileExistsError as error:
        raise RunError(
            f"sequence_files.unchanged: '{link.name}' holds images that are replaced; name the files beside them"
        ) from error


def _place(sequence: Sequence, path: Path) -> str:
    """Return the path of an image below the folder of the data set; one that lies elsewhere is at the top."""
    inside = path.is_relative_to(sequence.root)
    return PurePosixPath(path.relative_to(sequence.root)).as_posix() if inside else path.name


def _found(sequence: Sequence, name: str) -> Path:
    path = sequence.root / name
    if not path.exists():
        raise RunError(f"sequence_files: '{name}' is not in {sequence.root}; correct the definition or the data set")
    return path.absolute()


def _files_in(path: Path) -> Iterator[Path]:
    yield from sorted(found for found in path.rglob("*") if found.is_file()) if path.is_dir() else [path]


def _digest_of(path: Path) -> str:
    stamps = tuple((str(file), (stat := os.stat(file)).st_size, stat.st_mtime_ns) for file in _files_in(path))
    return _digest_of_files(path, stamps)


@lru_cache(maxsize=64)
def _digest_of_files(path: Path, stamps: tuple[tuple[str, int, int], ...]) -> str:
    """Return the digest of names and contents, computed once for as long as sizes and times stay."""
    return digest({os.path.relpath(name, path): file_digest(Path(name)) for name, _, _ in stamps})
