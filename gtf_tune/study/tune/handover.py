"""Hand over what was found: both models, the scripts that make them, and what other programs read.

The models are made by the very script that is handed over, from the original images at full size.
"""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gtf_tune.errors import RunError, StorageError
from gtf_tune.pipelines import OptionValue, Pipeline
from gtf_tune.sequence import Sequence
from gtf_tune.study.outcome.export import option_json

if TYPE_CHECKING:
    from gtf_tune.pipelines.colmap.models import SparseModel
    from gtf_tune.trajectory import Trajectory

MARK = ".gtf-tune.json"
"""File by which an output folder is known to be ours, so that it may be replaced."""

_LOG_LINES = 3


@dataclass(frozen=True)
class Configurations:
    """The two configurations that are reconstructed, each as the options that differ from the pipeline's defaults."""

    adopted: Mapping[str, OptionValue]
    nominal: Mapping[str, OptionValue]


@dataclass(frozen=True)
class Handover:
    """What was written.

    ``vetoed`` says why the adopted configuration is not handed over after all; empty where it is.
    """

    folder: Path
    adopted: "SparseModel"
    nominal: "SparseModel"
    vetoed: str = ""


def check_output(folder: Path) -> None:
    """Raise `StorageError` if a folder holds something that this command did not write."""
    if folder.exists() and not (folder / MARK).is_file() and (not folder.is_dir() or any(folder.iterdir())):
        raise StorageError(f"{folder} holds something else; choose another output folder or remove it")


def hand_over(
    folder: Path,
    sequence: Sequence,
    pipeline: Pipeline,
    configurations: Configurations,
    announce: Callable[[str], None] = lambda _: None,
) -> Handover:
    """Reconstruct with both configurations and write everything into ``folder``, in place of an earlier handover.

    A model of the adopted configuration that lost images or points on the whole sequence is not handed over: nominal
    takes its place.

    Raises
    ------
    StorageError
        The folder holds something else or cannot be written.
    RunError
        A reconstruction failed; the reason is in the message.
    """
    from gtf_tune.pipelines.colmap.models import read_model, transforms_json
    from gtf_tune.pipelines.colmap.script import Photographs, pycolmap_script
    from gtf_tune.pipelines.colmap.shell import colmap_shell_script
    from gtf_tune.trajectory import write_tum

    check_output(folder)
    images, names = _common_folder(sequence)
    camera = sequence.camera.scaled(*sequence.stored_size) if sequence.camera else None
    photographs = Photographs(images, list(names), camera)
    settings: Mapping[str, object] = dict(pipeline.settings)
    with _written_aside(folder) as work:
        _write(work / "images.txt", "".join(f"{name}\n" for name in names))
        _write(work / "run.py", pycolmap_script(pipeline.name, photographs, settings, pipeline.version))
        _write(work / "options-nominal.json", option_json(configurations.nominal))
        _write(work / "options.json", option_json(configurations.adopted))
        announce(f"reconstructing {len(names)} images with the nominal options")
        _reconstruct(work, "sparse-nominal", "options-nominal.json")
        nominal = read_model(work / "sparse-nominal" / "0", names)
        adopted, vetoed = nominal, ""
        if configurations.adopted != configurations.nominal:
            announce(f"reconstructing {len(names)} images with the adopted options")
            _reconstruct(work, "sparse", "options.json")
            adopted = read_model(work / "sparse" / "0", names)
            vetoed = _contradicted(adopted, nominal)
        if adopted is nominal or vetoed:
            adopted = _take_nominal(work, nominal)
        chosen = configurations.nominal if vetoed else configurations.adopted
        _write(work / "run.sh", colmap_shell_script(pipeline.name, photographs, settings, dict(chosen)))
        write_tum(adopted.trajectory, work / "trajectory.txt")
        write_tum(nominal.trajectory, work / "trajectory-nominal.txt")
        _write(work / "transforms.json", transforms_json(work / "sparse" / "0", images))
        _write(work / MARK, json.dumps({"sequence": sequence.name, "pipeline": pipeline.name}) + "\n")
    return Handover(folder, adopted, nominal, vetoed)


def hand_over_trajectories(
    folder: Path, configurations: Configurations, trajectories: "Mapping[str, Trajectory]"
) -> None:
    """Write options and trajectories of a pipeline that makes no COLMAP model, in place of an earlier handover.

    ``trajectories`` are those of a clean run, by ``adopted`` and ``nominal``.

    Raises
    ------
    StorageError
        The folder holds something else or cannot be written.
    """
    from gtf_tune.trajectory import write_tum

    check_output(folder)
    with _written_aside(folder) as work:
        _write(work / "options.json", option_json(configurations.adopted))
        _write(work / "options-nominal.json", option_json(configurations.nominal))
        write_tum(trajectories["adopted"], work / "trajectory.txt")
        write_tum(trajectories["nominal"], work / "trajectory-nominal.txt")
        _write(work / MARK, "{}\n")


def makes_models(pipeline: str) -> bool:
    """Whether a pipeline is COLMAP's, so that models can be handed over."""
    return pipeline in ("glomap", "colmap", "colmap-hierarchical")


def scaled_to(options: Mapping[str, OptionValue], pixels: frozenset[str], factor: float) -> dict[str, OptionValue]:
    """Return options for images that are ``factor`` times as large, where those named in ``pixels`` are in pixels."""
    return {
        name: value * factor if name in pixels and isinstance(value, float) else value
        for name, value in options.items()
    }


def _contradicted(adopted: "SparseModel", nominal: "SparseModel") -> str:
    """Return how the adopted configuration contradicts nominal on the whole sequence; empty where it does not."""
    from gtf_tune.study.outcome.contradiction import CleanRun, contradictions

    both = [
        CleanRun(model.trajectory, float(model.num_points), model.mean_track_length) for model in (nominal, adopted)
    ]
    found = contradictions(both[:1], both[1:], explained=0.0)
    return f"on all images the adopted configuration {found[0]}" if found else ""


def _take_nominal(work: Path, nominal: "SparseModel") -> "SparseModel":
    """Put the nominal model and options in the place of the adopted ones."""
    shutil.rmtree(work / "sparse", ignore_errors=True)
    shutil.copytree(work / "sparse-nominal", work / "sparse")
    shutil.copyfile(work / "options-nominal.json", work / "options.json")
    return nominal


def _common_folder(sequence: Sequence) -> tuple[Path, dict[str, tuple[int, float]]]:
    """Return the folder that holds all images, and frame id and timestamp by the name below it."""
    folder = Path(os.path.commonpath([frame.path.absolute().parent for frame in sequence.frames]))
    names = {
        frame.path.absolute().relative_to(folder).as_posix(): (frame.frame_id, frame.timestamp)
        for frame in sequence.frames
    }
    return folder, names


def _reconstruct(work: Path, name: str, options: str) -> None:
    """Run the script in a process of its own; its output stays beside the model."""
    log = work / f"{name}.log"
    with log.open("wb") as output:
        done = subprocess.run(
            [sys.executable, "run.py", name, options],
            cwd=work,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            check=False,
        )
    if done.returncode:
        last = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-_LOG_LINES:]
        reason = " / ".join(last) or f"exit code {done.returncode}"
        raise RunError(f"the reconstruction with {options} failed: {reason}")


@contextlib.contextmanager
def _written_aside(folder: Path) -> Iterator[Path]:
    """Yield a new folder beside ``folder`` that takes its place once it is complete."""
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        work = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    except OSError as error:
        raise StorageError(f"{folder} cannot be written ({error.strerror}); choose another output folder") from error
    try:
        yield work
        if folder.exists():
            shutil.rmtree(folder)
        work.chmod(0o755)
        work.rename(folder)
    except OSError as error:
        raise StorageError(
            f"{folder} cannot be written ({error.strerror}); free some space or choose another output folder"
        ) from error
    finally:
        shutil.rmtree(work, ignore_errors=True)


def _write(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", errors="surrogateescape")
