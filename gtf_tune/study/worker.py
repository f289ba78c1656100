"""Work on a study: claim a slot, let the sampler choose, run, score, tell, until the budget is spent."""

import threading
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from gtf_tune.execution import Executor
from gtf_tune.store import slots, studies, trials
from gtf_tune.store.workers import Worker, this_worker
from gtf_tune.study import optuna_trials
from gtf_tune.study.evaluation import Interrupted
from gtf_tune.study.events import Silent, StudyListener
from gtf_tune.study.heartbeat import GRACE_S, Heartbeat
from gtf_tune.study.opened import OpenStudy
from gtf_tune.study.sizing import sizing_of
from gtf_tune.study.stop import FINISH_RUNS, StopRequest
from gtf_tune.study.trial import TrialRunner

_POLL_S = 1.0


@dataclass(frozen=True)
class StudyWorker:
    """Work on one open study in this process until its budget is spent or someone asks to stop.

    Several workers, on one or many machines, may serve the same study: slots of the budget are handed out by the
    database, each to one live worker, and the slots of dead workers are adopted with everything they had finished.
    ``grace_s`` is how long a worker may be silent before it counts as dead.
    """

    study: OpenStudy
    executor: Executor
    stop: StopRequest = field(default_factory=StopRequest)
    listener: StudyListener = field(default_factory=Silent)
    grace_s: float = GRACE_S
    worker: Worker = field(default_factory=this_worker)

    def work(self, trial_parallel: int = 1) -> bool:
        """Work until nothing is left to do, and return whether the study is complete."""
        with Heartbeat(self.study.database) as heartbeat, ThreadPoolExecutor(trial_parallel) as pool:
            runner = TrialRunner(
                study=self.study,
                executor=self.executor,
                sizing=sizing_of(self.study.definition),
                stop=self.stop,
                listener=self.listener,
                heartbeat=heartbeat,
                ask_lock=threading.Lock(),
            )
            served = [pool.submit(self._serve, runner) for _ in range(trial_parallel)]
        for one in served:
            one.result()
        return self._close_if_complete()

    def _serve(self, runner: TrialRunner) -> None:
        while not self.stop.level:
            self._tell_untold()
            slot = self._next_slot()
            if slot is not None:
                self._run(runner, slot)
            elif self._others_at_work():
                self.stop.wait(_POLL_S)
            else:
                return

    def _run(self, runner: TrialRunner, slot: slots.Slot) -> None:
        try:
            runner.run(slot)
        except Interrupted:
            return
        except BaseException:
            self.stop.ask(FINISH_RUNS)
            raise

    def _next_slot(self) -> slots.Slot | None:
        """Return a slot to work on, or ``None`` where there is none now: trial 0 comes before all others."""
        database, study_id = self.study.database, self.study.record.id
        adopted = slots.adopt_stale(database, study_id, self.worker, self.grace_s)
        if adopted is not None:
            return adopted
        known = trials.counts(database, study_id)
        if known and known == {"claimed": 1} and trials.get(database, study_id, 0).state == "claimed":
            return None
        return slots.claim_slot(database, study_id, self.study.budget, self.worker)

    def _tell_untold(self) -> None:
        """Tell Optuna the end of trials whose worker died between storing and telling it."""
        for trial in trials.untold(self.study.database, self.study.record.id):
            if trial.optuna_number is not None and trial.value is not None:
                optuna_trials.tell(self.study.optuna_study, trial.optuna_number, trial.value, trial.state)

    def _others_at_work(self) -> bool:
        return trials.counts(self.study.database, self.study.record.id).get("claimed", 0) > 0

    def _close_if_complete(self) -> bool:
        database, study_id = self.study.database, self.study.record.id
        counts = trials.counts(database, study_id)
        done = sum(counts.values()) >= self.study.budget and not counts.get("claimed", 0)
        if done:
            studies.set_state(database, study_id, "done")
        return done
