"""The trajectories of one configuration."""

from dataclasses import dataclass

from gtf_tune.report.study_data import StudyData
from gtf_tune.store.database import Database
from gtf_tune.study.runs.sequence_runs import stored_by_sequence
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
    found = stored_by_sequence(database, [use for use in data.runs if use.number == number])
    return {
        name: ConfigurationRuns(title, runs.clean, runs.noisy, runs.num_frames, data.definition.gtf.alignment)
        for name, runs in ((sequence.name, found.get(sequence.name)) for sequence in data.sequences)
        if runs is not None
    }
