"""Write the shell script that reconstructs a sequence with a configuration through COLMAP's command line."""

import shlex
from collections.abc import Iterator, Mapping

from gtf_tune.pipelines.colmap.flags import command_of, commands_of, flag_of
from gtf_tune.pipelines.colmap.script import Photographs
from gtf_tune.pipelines.options import OptionValue

_CALIBRATOR = "view_graph_calibrator"
_EXTRACTOR = "feature_extractor"
_READS_IMAGES = (_EXTRACTOR, "mapper", "hierarchical_mapper", "global_mapper")
_WRITES_MODEL = ("mapper", "hierarchical_mapper", "global_mapper")
_HEAD = """\
#!/bin/sh
# Reconstruct with COLMAP 4.1 or newer: sh run.sh [FOLDER]
set -e
cd "$(dirname "$0")"
out=${1:-sparse-colmap}
mkdir -p "$out"
"""
_HEAD_FOR_ANY_IMAGES = """\
#!/bin/sh
# Reconstruct with COLMAP 4.1 or newer: sh run.sh IMAGES [FOLDER]
set -e
images=${1:?give the folder of the images}
out=${2:-sparse-colmap}
mkdir -p "$out"
"""
UNKNOWN = "unknown"
KNOWN = "known"
_GIVE_KNOWN = "# the intrinsics are known; give those of the images at full size as --ImageReader.camera_params\n"
_WHEN_UNKNOWN = "# only where the intrinsics are unknown; give known ones as --ImageReader.camera_params\n"


def colmap_shell_script(
    pipeline: str,
    photographs: Photographs | None,
    settings: Mapping[str, object],
    options: Mapping[str, OptionValue],
    camera: str = "",
) -> str:
    """Return the text of ``run.sh``: COLMAP's commands in running order, with all paths.

    It reads ``images.txt`` beside it, or the list of each of several cameras; without ``photographs`` it takes the
    folder of the images as an argument, and ``camera`` is the one that took them: a model and its parameters,
    `UNKNOWN`, `KNOWN` where the parameters cannot be given here, or nothing where the images may be of any camera.
    Options that the command line cannot set are named in comments;
    `pycolmap_script` sets them too.
    """
    pairing = str(settings.get("pairing", "exhaustive"))
    known = photographs.intrinsics_known if photographs else camera not in ("", UNKNOWN)
    commands = [name for name in commands_of(pipeline, pairing) if name != _CALIBRATOR or not known]
    flags: dict[str, list[str]] = {name: [] for name in commands}
    for flag, value in (*_from_settings(settings), *_options(pipeline, options)):
        command = command_of(pipeline, flag, pairing)
        if command in flags:
            flags[command].append(f"--{flag} {shlex.quote(value)}")
    lines: list[str] = []
    for name, given in flags.items():
        before = _WHEN_UNKNOWN * (name == _CALIBRATOR and photographs is None and not camera)
        before += _GIVE_KNOWN * (name == _EXTRACTOR and photographs is None and camera == KNOWN)
        for images in _cameras(photographs, settings, camera) if name == _EXTRACTOR else [[]]:
            words = (f"colmap {name}", *_paths(name, photographs), *images, *given)
            lines.append(before + " \\\n    ".join(words))
    missing = [name for name in options if flag_of(pipeline, name) is None]
    lines += [f"# COLMAP's command line cannot set {name} = {_text(options[name])}; run.py does" for name in missing]
    return (_HEAD if photographs else _HEAD_FOR_ANY_IMAGES) + "\n".join(lines) + "\n"


def _paths(command: str, photographs: Photographs | None) -> list[str]:
    paths = ["--database_path database.db" if photographs else '--database_path "$out/database.db"']
    if command in _READS_IMAGES:
        folder = shlex.quote(str(photographs.folder)) if photographs else '"$images"'
        paths.append(f"--image_path {folder}")
    if command in _WRITES_MODEL:
        paths.append('--output_path "$out"')
    return paths


def _cameras(photographs: Photographs | None, settings: Mapping[str, object], text: str) -> Iterator[list[str]]:
    """Yield the arguments by which features are found in the images of each camera."""
    if photographs is None:
        model, *params = text.split() if text not in ("", UNKNOWN, KNOWN) else [""]
        yield _camera(model, params, settings)
        return
    for file, (camera, _) in photographs.lists.items():
        model, params = (camera.model, [repr(value) for value in camera.params]) if camera else ("", [])
        yield [f"--image_list_path {file}", *_camera(model, params, settings)]


def _camera(model: str, params: list[str], settings: Mapping[str, object]) -> list[str]:
    chosen = model or str(settings.get("camera_model", "SIMPLE_RADIAL"))
    given = [f"--ImageReader.camera_params {','.join(params)}"] if params else []
    return ["--ImageReader.single_camera 1", f"--ImageReader.camera_model {shlex.quote(chosen)}", *given]


def _from_settings(settings: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    on_gpu = "1" if settings.get("device") == "cuda" else "0"  # COLMAP itself takes a GPU wherever there is one
    yield from ((f"{part}.use_gpu", on_gpu) for part in ("FeatureExtraction", "FeatureMatching"))
    if settings.get("vocab_tree_path") and settings.get("pairing") == "sequential":
        yield "SequentialMatching.vocab_tree_path", str(settings["vocab_tree_path"])


def _options(pipeline: str, options: Mapping[str, OptionValue]) -> Iterator[tuple[str, str]]:
    for name, value in options.items():
        flag = flag_of(pipeline, name)
        if flag is not None:
            yield flag, _text(value)


def _text(value: OptionValue) -> str:
    if isinstance(value, bool):
        return "1" if value else "0"
    return repr(value) if isinstance(value, float) else str(value)
