"""Hand over what was found: the models, the scripts that make them, and what other programs read.

The models are made by the very script that is handed over, from the original images. The nominal one is made before
the search, which shows how long reconstructions take; it is a valid outcome until something better is confirmed.
"""

import contextlib
import json
import math
import shutil
import tempfile
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from gtf_tune.errors import RunError, StorageError
from gtf_tune.pipelines import OptionValue, Pipeline
from gtf_tune.sequence import Sequence
from gtf_tune.study.outcome.export import option_json
from gtf_tune.study.tune.reconstruct import (
    MARK,
    MATCHES,
    Reconstructed,
    Workshop,
    common_folder,
    contradicted,
    size_option,
    write_text,
)

if TYPE_CHECKING:
    from gtf_tune.pipelines.colmap.models import SparseModel
    from gtf_tune.trajectory import Trajectory

UNCONFIRMED_MODEL = "sparse-unconfirmed"
_LEAST_CALIBRATION = 1e-3


@dataclass(frozen=True)
class Configurations:
    """The configurations that are reconstructed, each as the options that differ from the pipeline's defaults.

    ``adopted`` is what `sparse/0` is made with, and ``label`` says to its users what that is: nominal or adopted, and
    why. ``unconfirmed`` is the best of a search that was not confirmed, for a folder of its own.
    """

    adopted: Mapping[str, OptionValue]
    nominal: Mapping[str, OptionValue]
    unconfirmed: Mapping[str, OptionValue] | None = None
    label: str = ""


@dataclass(frozen=True)
class Handover:
    """What was written.

    ``label`` says what the model in `sparse/0` is, which ``adopted`` describes. ``moved_by_calibration`` is how far the
    trajectory moves where all intrinsics are refined, as a fraction of its extent; NaN where that was not looked at.
    """

    folder: Path
    label: str
    adopted: "SparseModel"
    nominal: Reconstructed
    unconfirmed: "SparseModel | None" = None
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
    folder: Path, workshop: Workshop, configurations: Configurations, *, check_until: float = 0.0, is_last: bool = True
) -> Handover:
    """Reconstruct with both configurations and write everything into ``folder``, in place of an earlier handover.

    A nominal model that is there already is kept. A model of another configuration that fails, or lost images or
    points on the whole sequence, is not handed over: nominal takes its place. If that can end before ``check_until``,
    on the monotonic clock, the intrinsics are refined once more than the options say, for
    ``Handover.moved_by_calibration``. Features and matches stay in the folder unless the handover ``is_last``.

    Raises
    ------
    StorageError
        The folder holds something else or cannot be written.
    RunError
        The nominal reconstruction failed; the reason is in the message.
    TooSlow
        It took longer than ``timeout_s``.
    """
    check_output(folder)
    sequence, pipeline = workshop.sequence, workshop.pipeline
    with _written_aside(folder) as work:
        _write_scripts(work, sequence, pipeline, configurations)
        nominal = workshop.nominal(work, folder, configurations.nominal)
        configurations, other = _with_other(work, workshop, configurations, nominal)
        adopted = nominal.model if other is None or configurations.unconfirmed is not None else other
        if adopted is nominal.model:
            shutil.copytree(work / "sparse-nominal", work / "sparse")
        moved = math.nan
        left_s = check_until - time.monotonic()
        if left_s > 2 * nominal.mapping_s:
            workshop.timeout_s = left_s
            moved = workshop.moved_by_calibration(work, adopted, configurations.adopted)
        if is_last:
            _tidy(work)
        _write_rest(work, workshop, adopted, nominal)
    unconfirmed = other if configurations.unconfirmed is not None else None
    return Handover(folder, configurations.label, adopted, nominal, unconfirmed, moved)


def _with_other(
    work: Path, workshop: Workshop, configurations: Configurations, nominal: Reconstructed
) -> "tuple[Configurations, SparseModel | None]":
    """Return the model that is made beside nominal, if any, and the configurations without one that cannot be used."""
    name = "sparse" if configurations.unconfirmed is None else UNCONFIRMED_MODEL
    options = configurations.adopted if configurations.unconfirmed is None else configurations.unconfirmed
    if options == configurations.nominal:
        return configurations, None
    try:
        model = workshop.in_time(nominal.mapping_s).reconstruct(work, name, options).model
        reason = contradicted(model, nominal.model)
    except RunError as error:
        reason = str(error)
    if not reason:
        return configurations, model
    shutil.rmtree(work / name, ignore_errors=True)
    (work / "options-unconfirmed.json").unlink(missing_ok=True)
    label = f"NOMINAL options. The best trial is not handed over: {reason}."
    configurations = Configurations(configurations.nominal, configurations.nominal, label=label)
    _write_scripts(work, workshop.sequence, workshop.pipeline, configurations)
    return configurations, None


def _write_rest(work: Path, workshop: Workshop, adopted: "SparseModel", nominal: Reconstructed) -> None:
    """Write what other programs read, and by what the folder is known."""
    from gtf_tune.pipelines.colmap.models import transforms_json
    from gtf_tune.trajectory import write_tum

    images, _ = common_folder(workshop.sequence)
    write_tum(adopted.trajectory, work / "trajectory.txt")
    write_tum(nominal.model.trajectory, work / "trajectory-nominal.txt")
    write_text(work / "transforms.json", transforms_json(work / "sparse" / "0", images))
    times = {"whole_s": nominal.whole_s, "mapping_s": nominal.mapping_s}
    write_text(work / MARK, json.dumps({**workshop.mark, **times}) + "\n")


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
        write_text(work / MARK, json.dumps({"sequence": sequence.name, "pipeline": pipeline.name}) + "\n")


def _write_scripts(work: Path, sequence: Sequence, pipeline: Pipeline, configurations: Configurations) -> None:
    from gtf_tune.pipelines.colmap.script import Photographs, pycolmap_script
    from gtf_tune.pipelines.colmap.shell import colmap_shell_script

    images, names = common_folder(sequence)
    cameras = [camera.stored_intrinsics for camera in sequence.cameras]
    photographs, settings = Photographs(images, list(names), cameras, sequence.taken_by), dict(pipeline.settings)
    size, label = size_option(sequence), " ".join((configurations.label or "Options as in options.json").split())
    adopted = {**configurations.adopted, **size}
    for file, (_, listed) in photographs.lists.items():
        write_text(work / file, "".join(f"{name}\n" for name in listed))
    write_text(work / "run.py", pycolmap_script(pipeline.name, photographs, settings, pipeline.version))
    shell = colmap_shell_script(pipeline.name, photographs, settings, adopted)
    write_text(work / "run.sh", shell.replace("\n", f"\n# {label}\n", 1))
    write_text(work / "options-nominal.json", option_json({**configurations.nominal, **size}))
    write_text(work / "options.json", option_json(adopted))
    if configurations.unconfirmed is not None:
        write_text(work / "options-unconfirmed.json", option_json({**configurations.unconfirmed, **size}))
    write_text(work / "README.txt", _readme(sequence, configurations.unconfirmed is not None, label))


def _readme(sequence: Sequence, has_unconfirmed: bool, label: str) -> str:
    """Return what the models of a folder are, the most important line first."""
    lines = [f"sparse/0, options.json, run.sh, trajectory.txt, transforms.json: {label}"]
    if has_unconfirmed:
        lines.append(
            f"{UNCONFIRMED_MODEL}/0, options-unconfirmed.json: best trial of the search, NOT CONFIRMED on fresh noise."
        )
    lines.append("sparse-nominal/0, options-nominal.json, trajectory-nominal.txt: the nominal options.")
    if size_option(sequence):
        lines.append(
            f"Made from {len(sequence)} images reduced to {sequence.width}x{sequence.height} pixels: there was no time "
            "for all of it. 'gtf-tune study export NAME' writes the scripts for the images at full size."
        )
    return "\n".join(lines) + "\n"


def _tidy(work: Path) -> None:
    """Remove what was only needed to make and check the models."""
    shutil.rmtree(work / "sparse-refined", ignore_errors=True)
    for scrap in (*work.glob("*.log"), *work.glob(MATCHES), work / "sparse-refined.json"):
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
    chosen, kind = configurations.adopted, "" if configurations.unconfirmed is None else "-unconfirmed"
    options = {"": chosen, "-nominal": configurations.nominal, kind: configurations.unconfirmed or chosen}
    poses = {"": trajectories["nominal"], "-nominal": trajectories["nominal"], kind: trajectories["adopted"]}
    with _written_aside(folder) as work:
        for name in options:
            write_text(work / f"options{name}.json", option_json(options[name]))
            write_tum(poses[name], work / f"trajectory{name}.txt")
        lines = [f"options.json, trajectory.txt: {configurations.label}"]
        lines += ["*-unconfirmed.*: best trial of the search, NOT CONFIRMED on fresh noise."] if kind else []
        write_text(work / "README.txt", "\n".join(lines) + "\n")
        write_text(work / MARK, "{}\n")


def model_folders(folder: Path, study: str) -> dict[str, Path]:
    """Return the models that were handed over for a study, by what they are, nominal first; none where others lie."""
    if not (folder / MARK).is_file() or json.loads((folder / MARK).read_text() or "{}").get("study") != study:
        return {}
    found = {"nominal options": folder / "sparse-nominal" / "0"}
    if (folder / "options.json").read_bytes() != (folder / "options-nominal.json").read_bytes():
        found["adopted options"] = folder / "sparse" / "0"
    found["best trial, not confirmed"] = folder / UNCONFIRMED_MODEL / "0"
    return {title: model for title, model in found.items() if model.is_dir()}


def makes_models(pipeline: str) -> bool:
    """Whether a pipeline is COLMAP's, so that models can be handed over."""
    return pipeline in ("glomap", "colmap", "colmap-hierarchical")


def changed_options(pipeline: Pipeline, options: Mapping[str, OptionValue]) -> dict[str, OptionValue]:
    """Return the options that differ from the pipeline's defaults."""
    return {name: value for name, value in options.items() if value != pipeline.options.specs[name].default}


def scaled_to(options: Mapping[str, OptionValue], pixels: frozenset[str], factor: float) -> dict[str, OptionValue]:
    """Return options for images that are ``factor`` times as large, where those named in ``pixels`` are in pixels."""
    return {
        name: value * factor if name in pixels and isinstance(value, float) else value
        for name, value in options.items()
    }


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
