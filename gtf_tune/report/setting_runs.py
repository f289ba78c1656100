"""Read the trajectories of one setting."""

from collections.abc import Sequence

from gtf_tune.pipelines.run import RunKind
from gtf_tune.report.study_data import StudyData
from gtf_tune.report.tables.trajectories import SettingRuns
from gtf_tune.store.database import Database
from gtf_tune.store.runs import TrialRun
from gtf_tune.store.trajectories import trajectories
from gtf_tune.trajectory import Trajectory


def read_setting(database: Database, data: StudyData, name: str, ordinal: int) -> dict[str, SettingRuns]:
    """Return the runs of one trial by sequence, under the given name; sequences without runs are absent.

    Raises
    ------
    StorageError
        A trajectory is not the one that was stored.
    """
    used = [one for one in data.runs if one.ordinal == ordinal]
    found = trajectories(database, sorted({one.run.key for one in used}))
    settings = {}
    for sequence in data.sequences:
        mine = [one for one in used if one.sequence_name == sequence.name]
        if mine:
            clean, noisy = _of_kind(mine, "clean", found), _of_kind(mine, "noisy", found)
            settings[sequence.name] = SettingRuns(
                name, clean, noisy, sequence.num_frames, data.definition.gtf.alignment
            )
    return settings


def _of_kind(used: Sequence[TrialRun], kind: RunKind, found: dict[str, Trajectory]) -> tuple[Trajectory, ...]:
    ordered = sorted((one for one in used if one.run.kind == kind), key=lambda one: one.run.index)
    return tuple(found[one.run.key] for one in ordered)
