"""What it takes to repeat a study."""

import json
from dataclasses import dataclass

from gtf_tune.display import nominal_text
from gtf_tune.report.drawing import markup
from gtf_tune.report.panels.base import Block, Panel, ReportInput
from gtf_tune.report.study_data import StudyData
from gtf_tune.store.studies import StudySequence


@dataclass(frozen=True)
class SequenceOrigin:
    """What identifies the images of one sequence; ``sigma`` is the noise in grey levels, as text."""

    name: str
    role: str
    path: str
    layout: str
    frames: int
    size: str
    camera: str
    has_ground_truth: bool
    sigma: str
    fingerprint: str


@dataclass(frozen=True)
class Provenance:
    """Definition of a study as indented JSON, versions of the programs that ran, seeds and sequences."""

    definition: str
    versions: tuple[tuple[str, str], ...]
    seed: int
    sampler: str
    sequences: tuple[SequenceOrigin, ...]
    threads: tuple[int, ...]


def provenance(data: StudyData) -> Provenance:
    """Return what a study depends on."""
    sigmas = data.study.resolved.get("noise_sigma") or {}
    return Provenance(
        definition=json.dumps(json.loads(data.study.definition), indent=2, ensure_ascii=False),
        versions=_versions(data),
        seed=data.definition.search.seed,
        sampler=data.definition.search.sampler,
        sequences=tuple(
            SequenceOrigin(
                name=sequence.name,
                role="searched" if sequence in data.sequences else "held out",
                path=sequence.path,
                layout=sequence.layout,
                frames=sequence.num_frames,
                size=f"{sequence.width} x {sequence.height}",
                camera=_camera_words(sequence),
                has_ground_truth=sequence.has_ground_truth,
                sigma=str(sigmas.get(sequence.name, data.definition.gtf.noise_sigma)),
                fingerprint=sequence.fingerprint,
            )
            for sequence in (*data.sequences, *data.holdouts)
        ),
        threads=tuple(sorted({use.run.threads for use in data.runs})),
    )


def reproducibility_panel(report: ReportInput) -> list[Block]:
    """Return versions, seeds, fingerprints and the whole definition of the study."""
    found = provenance(report.data)
    facts = [*found.versions, ("sampler", found.sampler), ("seed of the study", str(found.seed))]
    facts.append(("nominal setting", nominal_text(report.data.definition)))
    facts.append(("threads of a run", ", ".join(str(threads) for threads in found.threads) or "-"))
    facts.append(("storage", report.data.storage))
    sequences = [
        (
            sequence.name,
            sequence.role,
            sequence.path,
            sequence.layout,
            sequence.frames,
            sequence.size,
            sequence.camera,
            sequence.sigma,
            "yes" if sequence.has_ground_truth else "no",
            markup.cell(markup.code(sequence.fingerprint)),
        )
        for sequence in found.sequences
    ]
    columns = [
        "sequence",
        "role",
        "path",
        "layout",
        ">frames",
        ">size [px]",
        "camera",
        ">noise [grey levels]",
        "ground truth",
    ]
    return [
        markup.table(["what", "value"], facts),
        markup.table([*columns, "fingerprint"], sequences),
        markup.folded("Definition of the study", markup.snippet("definition (JSON)", found.definition)),
    ]


def _camera_words(sequence: StudySequence) -> str:
    """Return the intrinsics that a sequence began with, or the focal length that runs start from."""
    prior = sequence.info.get("focal_prior")
    return sequence.camera if prior is None else f"{sequence.camera}, from a focal length of {prior:.1f} pixels"


def _versions(data: StudyData) -> tuple[tuple[str, str], ...]:
    """Return the versions at the creation of the study and of its runs, by name; several of one name are joined."""
    seen: dict[str, set[str]] = {}
    for versions in (data.study.resolved.get("versions") or {}, *(use.run.versions for use in data.runs)):
        for name, version in versions.items():
            seen.setdefault(str(name), set()).add(str(version))
    return tuple((name, ", ".join(sorted(found))) for name, found in sorted(seen.items()))


PANEL = Panel("Reproducibility", reproducibility_panel)
