"""Take back the verdicts of trials whose runs failed, so that workers try these runs again."""

from sqlalchemy import delete, select, update
from sqlalchemy.orm import Session

from gtf_tune.pipelines.run import digest
from gtf_tune.store.database import Database, models
from gtf_tune.store.database.session import write
from gtf_tune.store.optuna.tables import fail_trials
from gtf_tune.store.trial_queue import TrialResult


def reopen_failed(database: Database, study_id: int) -> int:
    """Give the ended trials of a study that used a failed run back to its workers, and return how many there are.

    Their failed runs stay stored, under keys by which nobody looks for runs; the others are used again. Optuna's trials
    of the verdicts become failed ones, from which samplers learn nothing.
    """

    def work(session: Session) -> list[int | None]:
        trial, link, run = models.Trial, models.TrialRun, models.Run
        query = (
            select(trial.id, trial.optuna_trial_id, run.id, run.key)
            .join(link, link.trial_id == trial.id)
            .join(run, run.id == link.run_id)
            .where(trial.study_id == study_id, trial.state.in_(("complete", "pruned")), run.status == "failed")
        )
        rows = session.execute(query).all()
        for run_id, key in {(run_id, key) for _, _, run_id, key in rows}:
            session.execute(delete(link).where(link.run_id == run_id, link.trial_id.in_({row[0] for row in rows})))
            session.execute(update(run).where(run.id == run_id).values(key=digest({"retried": key})))
        again = {**vars(TrialResult("failed")), "state": "claimed", "lease": None, "heartbeat_at": None}
        reopened = {trial_id: optuna_id for trial_id, optuna_id, _, _ in rows}
        statement = update(trial).where(trial.id.in_(reopened)).values(**again, finished_at=None)
        session.execute(statement.execution_options(synchronize_session=False))
        return list(reopened.values())

    optuna_ids = write(database, work)
    fail_trials(database, [trial_id for trial_id in optuna_ids if trial_id is not None])
    return len(optuna_ids)
