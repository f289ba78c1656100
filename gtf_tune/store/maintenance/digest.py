"""Sum a study up in one digest, to compare it across databases and against an undisturbed run."""

from sqlalchemy import select

from gtf_tune.pipelines.run import digest
from gtf_tune.store import ground_truth_errors, studies, trials
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import read_rows


def study_digest(database: Database, name: str) -> str:
    """Return the hex SHA-256 of what a study found out.

    It covers the pixels of the sequences, the trials (number, options, state, score to the bit), their runs (key,
    status, trajectory) and the side metric; not ids, hosts, times, or who made a run.
    """
    study = studies.get(database, name)
    return digest(
        {
            "sequences": [[sequence.name, sequence.fingerprint] for sequence in studies.sequences(database, study.id)],
            "trials": [
                [one.number, one.options, one.state, one.value, one.gtf_ate, one.feasible]
                for one in trials.of_study(database, study.id)
            ],
            "runs": _runs(database, study.id),
            "validations": [
                [number, one.sequence_name, one.value]
                for number, found in ground_truth_errors.of_study(database, study.id).items()
                for one in found
            ],
        }
    )


def _runs(database: Database, study_id: int) -> list[list[object]]:
    trial, link, run = models.Trial, models.TrialRun, models.Run
    query = (
        select(trial.number, link.sequence_name, link.kind, link.index, run.key, run.status, run.trajectory_digest)
        .join(link, link.trial_id == trial.id)
        .join(run, run.id == link.run_id)
        .where(trial.study_id == study_id)
    )
    # Sorted here: the databases order texts by different rules.
    return sorted([list(row) for row in read_rows(database, query)], key=repr)
