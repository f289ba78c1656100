"""Load the sequences of a study: as a definition says, or as a stored study began with them."""

from dataclasses import replace
from pathlib import Path

from gtf_tune.definition import SequenceDefinition
from gtf_tune.errors import SequenceError
from gtf_tune.pipelines import Pipeline, with_focal_prior
from gtf_tune.sequence import FEWEST_FRAMES, LOADING_RULES, Camera, Selection, Sequence, layout_names, load_sequence
from gtf_tune.store.studies import StudySequence

_FIRST_RULES = 1
_UNKNOWN = "unknown"


def load_defined_sequence(definition: SequenceDefinition, root: Path, pipeline: Pipeline) -> Sequence:
    """Load a sequence as its definition says, for work with a pipeline; relative paths start at ``root``.

    Raises
    ------
    SequenceError
        The sequence cannot be read, or has too few frames for trajectories to be compared.
    """
    return with_focal_prior(_load(definition, root / definition.path, LOADING_RULES), pipeline)


def load_stored_sequence(definition: SequenceDefinition, stored: StudySequence, folder: Path) -> tuple[Sequence, str]:
    """Load a sequence of a stored study, with the intrinsics that the study began with.

    Returns
    -------
    sequence, change
        The second is a sentence where the files at ``folder`` now say something else about the camera, otherwise "".

    Raises
    ------
    SequenceError
        The sequence cannot be read here, or has other pixels than when the study began.
    """
    rules = int(stored.info.get("loading_rules", _FIRST_RULES))
    definition = _in_stored_layout(definition, stored)
    fault = ""
    try:
        found = _load(definition, folder, rules)
    except SequenceError as error:
        found, fault = _load(definition.model_copy(update={"camera": _UNKNOWN}), folder, rules), str(error)
    prior = stored.info.get("focal_prior")
    sequence = replace(found, camera=_stored_camera(stored), focal_prior=None if prior is None else float(prior))
    check_fingerprint(sequence, stored.fingerprint)  # of what is handed out, which remembers the files that it saw
    if fault or found.camera != sequence.camera:
        return sequence, _change(sequence, found.camera, fault)
    return sequence, ""


def load_stored_images(definition: SequenceDefinition, stored: StudySequence, folder: Path) -> Sequence:
    """Load a sequence of a stored study to look at its images: without its camera, and whatever its pixels are now.

    Raises
    ------
    SequenceError
        The images cannot be read here.
    """
    rules = int(stored.info.get("loading_rules", _FIRST_RULES))
    definition = _in_stored_layout(definition, stored)
    return _load(definition.model_copy(update={"camera": _UNKNOWN}), folder, rules)


def sequence_row(path: str, sequence: Sequence) -> StudySequence:
    """Return what is stored of a sequence with a study, so that the study keeps it."""
    prior = {} if sequence.focal_prior is None else {"focal_prior": sequence.focal_prior}
    return StudySequence(
        name=sequence.name,
        path=path,
        layout=sequence.layout,
        fingerprint=sequence.fingerprint,
        num_frames=len(sequence),
        width=sequence.width,
        height=sequence.height,
        camera=_camera_text(sequence.camera),
        has_ground_truth=sequence.ground_truth is not None,
        info={"loading_rules": LOADING_RULES, **prior},
    )


def check_fingerprint(sequence: Sequence, expected: str) -> None:
    """Raise `SequenceError` if the pixels of a sequence are not those that the study began with."""
    if sequence.fingerprint != expected:
        raise SequenceError(
            f"sequence '{sequence.name}' at {sequence.root} has other pixels than when the study began "
            f"(fingerprint {sequence.fingerprint[:12]}, not {expected[:12]}); restore them, say where they lie, or "
            "create a new study",
            remedy=("sequence", sequence.name),
        )


def _in_stored_layout(definition: SequenceDefinition, stored: StudySequence) -> SequenceDefinition:
    """Return a definition with the layout that the study began with, where this version still knows it."""
    known = stored.layout in layout_names()
    return definition.model_copy(update={"layout": stored.layout}) if known else definition


def _load(definition: SequenceDefinition, folder: Path, rules: int) -> Sequence:
    sequence = load_sequence(
        folder,
        name=definition.name,
        layout=definition.layout,
        selection=Selection(**definition.selection, rules=rules),
        camera="auto" if definition.camera == "auto" else "unknown",
        fewest=FEWEST_FRAMES,
    )
    if isinstance(definition.camera, str):
        return sequence
    camera = Camera(definition.camera.model, *sequence.stored_size, params=tuple(definition.camera.params))
    return replace(sequence, camera=camera.scaled(sequence.width, sequence.height))


def _stored_camera(stored: StudySequence) -> Camera | None:
    if stored.camera == _UNKNOWN:
        return None
    model, *params = stored.camera.split()
    return Camera(model, stored.width, stored.height, tuple(float(value) for value in params))


def _camera_text(camera: Camera | None) -> str:
    return f"{camera.model} {' '.join(repr(value) for value in camera.params)}" if camera else _UNKNOWN


def _change(sequence: Sequence, now: Camera | None, fault: str) -> str:
    says = f"its files cannot be used any more ({fault})" if fault else f"its files now say {_camera_text(now)}"
    return (
        f"sequence '{sequence.name}' keeps the intrinsics that the study began with, {_camera_text(sequence.camera)}, "
        f"although {says}"
    )
