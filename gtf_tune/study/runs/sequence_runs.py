"""Runs of one configuration on one sequence: what every score is computed from."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from gtf_tune.pipelines.run import RunKind, RunRequest
from gtf_tune.store.database import Database
from gtf_tune.store.runs import StoredRun, TrialRun
from gtf_tune.store.trajectories import trajectories
from gtf_tune.trajectory import Trajectory


@dataclass(frozen=True, eq=False)
class FinishedRun:
    """Run that has ended and is stored, with its trajectory, which is empty if the run failed.

    ``reused`` is true where the run was stored before it was asked for.
    """

    request: RunRequest
    stored: StoredRun
    trajectory: Trajectory
    reused: bool


@dataclass(frozen=True, eq=False)
class SequenceRuns:
    """Trajectories of the clean and of the noisy runs of one configuration, in the order in which they count.

    Those of failed runs are empty, and ``errors`` says why runs failed, those of clean runs first. ``num_frames`` is
    the length of the sequence.
    """

    clean: tuple[Trajectory, ...]
    noisy: tuple[Trajectory, ...]
    num_frames: int
    errors: tuple[str, ...] = ()

    @property
    def clean_coverage(self) -> tuple[float, ...]:
        """Registered frames of each clean run over the frames of the sequence."""
        return tuple(len(run) / self.num_frames for run in self.clean)

    @property
    def noisy_coverage(self) -> tuple[float, ...]:
        """Registered frames of each noisy run over the frames of the sequence."""
        return tuple(len(run) / self.num_frames for run in self.noisy)


def sequence_runs(runs: Iterable[tuple[RunKind, Trajectory, str]], num_frames: int) -> SequenceRuns:
    """Return the runs of one sequence, given as kind, trajectory and error in the order in which they count."""
    listed = list(runs)
    clean, noisy = ([run for run in listed if run[0] == kind] for kind in ("clean", "noisy"))
    return SequenceRuns(
        clean=tuple(trajectory for _, trajectory, _ in clean),
        noisy=tuple(trajectory for _, trajectory, _ in noisy),
        num_frames=num_frames,
        errors=tuple(error for _, _, error in [*clean, *noisy] if error),
    )


def finished_by_sequence(runs: Sequence[FinishedRun]) -> dict[str, SequenceRuns]:
    """Return finished runs by the name of their sequence, in the order in which they are given."""
    frames = {run.request.sequence.name: len(run.request.sequence) for run in runs}
    return {
        name: sequence_runs(
            ((run.request.kind, run.trajectory, run.stored.error) for run in runs if run.request.sequence.name == name),
            num_frames,
        )
        for name, num_frames in frames.items()
    }


def stored_by_sequence(database: Database, runs: Sequence[TrialRun]) -> dict[str, SequenceRuns]:
    """Return the stored runs of one trial by the name of their sequence, ordered by their index.

    Raises
    ------
    StorageError
        A trajectory is not the one that was stored.
    """
    found = trajectories(database, list(dict.fromkeys(use.run.key for use in runs)))
    frames = {use.sequence_name: use.run.num_frames for use in runs}
    return {name: _of_stored(found, runs, name, num_frames) for name, num_frames in frames.items()}


def _of_stored(found: Mapping[str, Trajectory], runs: Sequence[TrialRun], name: str, num_frames: int) -> SequenceRuns:
    mine = sorted((use.run for use in runs if use.sequence_name == name), key=lambda run: run.index)
    return sequence_runs(((run.kind, found[run.key], run.error) for run in mine), num_frames)
