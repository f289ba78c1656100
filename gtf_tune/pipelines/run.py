"""Runs as values: what identifies a run and what comes out of it."""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

from gtf_tune.errors import MachineError
from gtf_tune.pipelines.base import DiagnosticValue, Pipeline
from gtf_tune.pipelines.options import OptionValue

if TYPE_CHECKING:  # whoever only reads studies needs neither images nor poses
    from gtf_tune.sequence import ImageSource, Sequence
    from gtf_tune.trajectory import Trajectory

RunKind = Literal["clean", "noisy"]
RunStatus = Literal["ok", "failed"]
FailureCause = Literal["configuration", "machine", "unknown", "killed", "terminated"]
"""Why a run failed: the program said so; this machine (disk, permissions, missing program); not known; SIGKILL; other
signals from outside. Executors try again what is not the configuration's, and return one of the first two."""


@dataclass(frozen=True)
class RunRequest:
    """What identifies a run: a pipeline with options on one clean or noisy copy of one sequence.

    ``index`` counts the clean or the noisy runs from 0. ``noise_sigma`` is in grey levels, 0 for clean runs. Both seeds
    are non-negative; ``noise_seed`` is 0 for clean runs, so that all of them share one set of images.
    """

    pipeline: Pipeline
    options: Mapping[str, OptionValue]
    sequence: "Sequence"
    kind: RunKind
    index: int
    noise_sigma: float
    noise_seed: int
    seed: int
    threads: int = 1

    @property
    def images(self) -> "ImageSource":
        """Return the images that the run reads: in colour for pipelines with ``channels`` 3, grey for others."""
        from gtf_tune.sequence import ImageSource

        return ImageSource(self.sequence, self.noise_sigma, self.noise_seed, getattr(self.pipeline, "channels", 1))

    @property
    def key(self) -> str:
        """Return the hex SHA-256 of everything that the result depends on.

        The times of frames are part of it only for pipelines with a true ``reads_times``, files beside
        the images only for those whose ``sequence_key`` names them.
        """
        prior = self.sequence.focal_prior if self.sequence.camera is None else None
        beside = getattr(self.pipeline, "sequence_key", lambda _: None)(self.sequence)
        reads_times = getattr(self.pipeline, "reads_times", False)
        return digest(
            {
                "pipeline": self.pipeline.name,
                "version": self.pipeline.version,
                "settings": dict(self.pipeline.settings),
                "options": dict(self.options),
                "images": self.images.key,
                "camera": self.sequence.cameras_key,
                "kind": self.kind,
                "index": self.index,
                "seed": self.seed,
                "threads": self.threads,
                **({} if prior is None else {"focal_prior": prior}),
                **({"times": [frame.timestamp for frame in self.sequence.frames]} if reads_times else {}),
                **({} if beside is None else {"sequence": beside}),
            }
        )


@dataclass(frozen=True)
class RunOutcome:
    """How a run ended.

    A failed run has an empty trajectory, a one-sentence ``error`` and a ``cause``; a failure that this machine caused
    says nothing about the configuration. ``attempts`` counts the times that the run was tried. ``wall_s`` is what the
    child process took, ``peak_memory_bytes`` its largest resident set, ``log`` the end of what it printed.
    """

    status: RunStatus
    trajectory: "Trajectory"
    error: str = ""
    diagnostics: Mapping[str, DiagnosticValue] = field(default_factory=dict)
    wall_s: float = 0.0
    peak_memory_bytes: int = 0
    host: str = ""
    started_at: float = 0.0
    versions: Mapping[str, str] = field(default_factory=dict)
    log: str = ""
    cause: FailureCause = "configuration"
    attempts: int = 1

    def raise_for_machine(self) -> None:
        """Raise `MachineError` where the machine is at fault, so that the outcome says nothing."""
        if self.status == "failed" and self.cause == "machine":
            raise MachineError(self.error)


def digest(value: object) -> str:
    """Return the hex SHA-256 of a JSON-serialisable value in canonical form.

    Floats are written by `repr`, so that equal keys mean equal bits.
    """
    text = json.dumps(value, sort_keys=True, separators=(",", ":"), allow_nan=True)
    return hashlib.sha256(text.encode()).hexdigest()
