"""Hand over what was found: both models, the scripts that make them, and what other programs read.

The models are made by the very script that is handed over, from the original images at full size.
"""

import contextlib
import hashlib
import json
import math
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
_REFINED = ("refine_focal_length", "refine_extra_params", "refine_principal_point")
_LEAST_CALIBRATION = 1e-3


@dataclass(frozen=True)
class Configurations:
    """The two configurations that are reconstructed, each as the options that differ from the pipeline's defaults."""

    adopted: Mapping[str, OptionValue]
    nominal: Mapping[str, OptionValue]


@dataclass(frozen=True)
class Handover:
    """What was written.

    ``vetoed`` says why the adopted configuration is not handed over after all; empty where it is.
    ``moved_by_calibration`` is how far the trajectory moves where all intrinsics are refined, as a fraction of its
    extent; NaN where that was not looked at.
    """

    folder: Path
    adopted: "SparseModel"
    nominal: "SparseModel"
    vetoed: str = ""
    moved_by_calibration: float = math.nan

    def calibration_limit(self, movement: float) -> str:
        """Return a sentence where the calibration limits the accuracy more than noise does; else nothing.

        ``movement`` is how far the trajectory moves under noise, as a fraction of its extent.
        """
        if not self.moved_by_calibration > max(movement, _LEAST_CALIBRATION):
            return ""
        return (
            "Calibration, not the options, limits the accuracy here: where all intrinsics are refined the trajectory "
            f"moves by {1000 * self.moved_by_calibration:.3g} per mille of its extent, under noise by "
            f"{1000 * movement:.3g}; calibrate the camera, or let the program refine the intrinsics."
        )


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
    *,
    check: bool = False,
) -> Handover:
    """Reconstruct with both configurations and write everything into ``folder``, in place of an earlier handover.

    A model of the adopted configuration that lost images or points on the whole sequence is not handed over: nominal
    takes its place. With ``check`` the intrinsics are refined once more than the options say, for
    ``Handover.moved_by_calibration``.

    Raises
    ------
    StorageError
        The folder holds something else or cannot be written.
    RunError
        A reconstruction failed; the reason is in the message.
    """
    from gtf_tune.pipelines.colmap.models import transforms_json
    from gtf_tune.trajectory import write_tum

    check_output(folder)
    images, names = _common_folder(sequence)
    with _written_aside(folder) as work:
        _write_scripts(work, sequence, pipeline, configurations)
        announce(f"reconstructing {len(names)} images with the nominal options")
        nominal = _reconstruct(work, "sparse-nominal", configurations.nominal, names)
        adopted, vetoed = nominal, ""
        if configurations.adopted != configurations.nominal:
            announce(f"reconstructing {len(names)} images with the adopted options")
            adopted = _reconstruct(work, "sparse", configurations.adopted, names)
            vetoed = _contradicted(adopted, nominal)
        if adopted is nominal or vetoed:
            configurations = Configurations(configurations.nominal, configurations.nominal)
            _write_scripts(work, sequence, pipeline, configurations)
            shutil.rmtree(work / "sparse", ignore_errors=True)
            shutil.copytree(work / "sparse-nominal", work / "sparse")
            adopted = nominal
        moved = _moved_by_calibration(work, adopted, configurations.adopted, pipeline, names) if check else math.nan
        _tidy(work)
        write_tum(adopted.trajectory, work / "trajectory.txt")
        write_tum(nominal.trajectory, work / "trajectory-nominal.txt")
        _write(work / "transforms.json", transforms_json(work / "sparse" / "0", images))
        _write(work / MARK, json.dumps({"sequence": sequence.name, "pipeline": pipeline.name}) + "\n")
    return Handover(folder, adopted, nominal, vetoed, moved)


def write_scripts(folder: Path, sequence: Sequence, pipeline: Pipeline, configurations: Configurations) -> None:
    """Write the scripts and options that make the models, without making them, in place of an earlier handover.

    Raises
    ------
    StorageError
        The folder holds something else or cannot be written.
    """
    check_output(folder)
    with _written_aside(folder) as work:
        _write_scripts(work, sequence, pipeline, configurations)
        _write(work / MARK, json.dumps({"sequence": sequence.name, "pipeline": pipeline.name}) + "\n")


def _write_scripts(work: Path, sequence: Sequence, pipeline: Pipeline, configurations: Configurations) -> None:
    from gtf_tune.pipelines.colmap.script import Photographs, pycolmap_script
    from gtf_tune.pipelines.colmap.shell import colmap_shell_script

    images, names = _common_folder(sequence)
    camera = sequence.camera.scaled(*sequence.stored_size) if sequence.camera else None
    photographs, settings = Photographs(images, list(names), camera), dict(pipeline.settings)
    _write(work / "images.txt", "".join(f"{name}\n" for name in names))
    _write(work / "run.py", pycolmap_script(pipeline.name, photographs, settings, pipeline.version))
    _write(work / "run.sh", colmap_shell_script(pipeline.name, photographs, settings, configurations.adopted))
    _write(work / "options-nominal.json", option_json(configurations.nominal))
    _write(work / "options.json", option_json(configurations.adopted))


def _moved_by_calibration(
    work: Path,
    model: "SparseModel",
    options: Mapping[str, OptionValue],
    pipeline: Pipeline,
    names: Mapping[str, tuple[int, float]],
) -> float:
    """Return how far the trajectory moves where the intrinsics are refined too, as a fraction of the extent.

    NaN where the pipeline cannot refine them, or the reconstruction fails.
    """
    from gtf_tune.metrics import AteSettings, pairwise_matrix

    free = {name: True for name in pipeline.options.specs if name.endswith(_REFINED)}
    if not free:
        return math.nan
    try:
        other = _reconstruct(work, "sparse-refined", {**options, **free}, names)
    except RunError:
        return math.nan
    found = pairwise_matrix([model.trajectory], [other.trajectory], AteSettings("sim3"))
    return float(found.errors[0, 0] / found.extents[0, 0])


def _tidy(work: Path) -> None:
    """Remove what was only needed to make and check the models."""
    shutil.rmtree(work / "sparse-refined", ignore_errors=True)
    for scrap in (*work.glob("*.log"), *work.glob("matches-*.db"), work / "sparse-refined.json"):
        scrap.unlink(missing_ok=True)


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


def _common_folder(sequence: Sequence) -> tuple[Path, dict[str, tuple[int, float]]]:
    """Return the folder that holds all images, and frame id and timestamp by the name below it."""
    folder = Path(os.path.commonpath([frame.path.absolute().parent for frame in sequence.frames]))
    names = {
        frame.path.absolute().relative_to(folder).as_posix(): (frame.frame_id, frame.timestamp)
        for frame in sequence.frames
    }
    return folder, names


def _reconstruct(
    work: Path, name: str, options: Mapping[str, OptionValue], names: Mapping[str, tuple[int, float]]
) -> "SparseModel":
    """Run the script in a process of its own, on the matches of an earlier call where they are the same."""
    from gtf_tune.pipelines.colmap.models import read_model

    _write(work / f"{name}.json", option_json(options))
    log, database = work / f"{name}.log", work / f"matches-{_matches_key(options)}.db"
    with log.open("wb") as output:
        done = subprocess.run(
            [sys.executable, "run.py", name, f"{name}.json", database.name],
            cwd=work,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            check=False,
        )
    (work / f"{name}.json").unlink()
    if done.returncode:
        last = log.read_text(encoding="utf-8", errors="replace").strip().splitlines()[-_LOG_LINES:]
        reason = " / ".join(last) or f"exit code {done.returncode}"
        raise RunError(f"the reconstruction in {name} failed: {reason}")
    return read_model(work / name / "0", names)


def _matches_key(options: Mapping[str, OptionValue]) -> str:
    """Return what names the database of features and verified matches that options lead to."""
    groups = ("extraction.", "matching.", "verification.", "exhaustive.", "sequential.")
    relevant = {name: value for name, value in sorted(options.items()) if name.startswith(groups)}
    return hashlib.sha256(json.dumps(relevant).encode()).hexdigest()[:12]


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
