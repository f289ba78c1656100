"""The trajectories of one configuration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from gtf_tune.pipelines.run import RunKind
from gtf_tune.report.study_data import StudyData
from gtf_tune.store.database import Database
from gtf_tune.store.runs import TrialRun
from gtf_tune.store.trajectories import trajectories
from gtf_tune.trajectory import Trajectory
from gtf_tune.trajectory.alignment import AlignmentKind


@dataclass(frozen=True, eq=False)
class ConfigurationRuns:
    """Trajectories of one configuration on one sequence; those of failed runs are empty."""

    title: str
    clean: tuple[Trajectory, ...]
    noisy: tuple[Trajectory, ...]
    num_frames: int
    alignment: AlignmentKind = "sim3"

    @property
    def reference(self) -> Trajectory | None:
        """The first clean run that has poses, to which the others are aligned; None where there is none."""
        return next((run for run in self.clean if len(run)), None)


def read_configuration(database: Database, data: StudyData, title: str, number: int) -> dict[str, ConfigurationRuns]:
    """Return the runs of one trial by sequence, under the given title; sequences without runs are absent.

    Raises
    ------
    StorageError
        A trajectory is not the one that was stored.
    """
    used = [use for use in data.runs if use.number == number]
    found = trajectories(database, sorted({use.run.key for use in used}))
    by_sequence = {}
    for sequence in data.sequences:
        uses = [use for use in used if use.sequence_name == sequence.name]
        if uses:
            by_sequence[sequence.name] = ConfigurationRuns(
                title,
                _of_kind(uses, "clean", found),
                _of_kind(uses, "noisy", found),
                sequence.num_frames,
                data.definition.gtf.alignment,
            )
    return by_sequence


def _of_kind(uses: Sequence[TrialRun], kind: RunKind, found: Mapping[str, Trajectory]) -> tuple[Trajectory, ...]:
    ordered = sorted((use for use in uses if use.run.kind == kind), key=lambda use: use.run.index)
    return tuple(found[use.run.key] for use in ordered)
