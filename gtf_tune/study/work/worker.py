"""Work on a study: claim a lease, let the sampler choose, run, score, tell, until the budget is spent."""

import random
import threading
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field

from gtf_tune.errors import DeletedError
from gtf_tune.execution import Executor
from gtf_tune.store import studies, trial_queue, trials
from gtf_tune.store.workers import Worker, this_worker
from gtf_tune.study.open_study import OpenStudy
from gtf_tune.study.runs.run_source import Interrupted
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest
from gtf_tune.study.scoring.early_stopping import sizing_of
from gtf_tune.study.search.samplers import make_sampler
from gtf_tune.study.work import optuna_trials
from gtf_tune.study.work.callbacks import Silent, StudyListener
from gtf_tune.study.work.heartbeat import GRACE_S, INTERVAL_S, Heartbeat
from gtf_tune.study.work.trial_runner import TrialRunner

_FIRST_POLL_S = 0.5
_LONGEST_POLL_S = 10.0
_SIGNAL_POLL_S = 0.5


@dataclass(frozen=True)
class StudyWorker:
    """Work on one open study in this process until its budget is spent or someone asks to stop.

    Several workers, on one or many machines, may serve the same study: trials of the budget are handed out by the
    database, each to one live worker, and the trials of dead workers are adopted with everything they had finished.
    A worker looks at the state of its study before every trial and with every heartbeat: it takes no trial of a paused
    study, and gives its trial back where the study is stopped. ``beat_s`` is how often it says that it lives, and
    ``grace_s`` how long a worker may be silent before it counts as dead.
    """

    study: OpenStudy
    executor: Executor
    stop: StopRequest = field(default_factory=StopRequest)
    listener: StudyListener = field(default_factory=Silent)
    beat_s: float = INTERVAL_S
    grace_s: float = GRACE_S
    worker: Worker = field(default_factory=this_worker)

    def work(self, trial_parallel: int = 1) -> bool:
        """Work until nothing is left to do, also waiting for other workers, and return whether the study is complete.

        Raises
        ------
        GtfTuneError
            This machine cannot go on: its database, disk or images are at fault.
        """
        return self._work(trial_parallel, self._others_at_work)

    def work_while_free(self, trial_parallel: int = 1) -> bool:
        """Work until no lease is free now, and return whether the study is complete.

        Raises
        ------
        GtfTuneError
            This machine cannot go on: its database, disk or images are at fault.
        """
        return self._work(trial_parallel, lambda: False)

    def _work(self, trial_parallel: int, others: Callable[[], bool]) -> bool:
        if not self._is_complete():  # lest a trial is begun that cannot go on
            make_sampler(self.study.definition.search, 0, self.study.space)
        stop = StopRequest(self.stop)
        with (
            Heartbeat(self.study.database, self.beat_s, lambda: self._heed_state(stop)) as heartbeat,
            ThreadPoolExecutor(trial_parallel) as pool,
        ):
            runner = TrialRunner(
                study=self.study,
                executor=self.executor,
                sizing=sizing_of(self.study.definition),
                stop=stop,
                listener=self.listener,
                heartbeat=heartbeat,
                ask_lock=threading.Lock(),
            )
            served = [
                pool.submit(self._serve, runner, lambda: heartbeat.holds_any or others()) for _ in range(trial_parallel)
            ]
            # Not left to the pool, which would wait without end: a signal that reaches another thread (measured, while
            # a process is being started) is only handled when this one wakes up.
            while wait(served, timeout=_SIGNAL_POLL_S).not_done:
                continue
        for one in served:
            one.result()
        return self._close_if_complete()

    def _serve(self, runner: TrialRunner, may_free: Callable[[], bool]) -> None:
        """Take trials one after the other; where there is none, wait as long as one ``may_free`` itself."""
        pause_s = _FIRST_POLL_S
        while not runner.stop.level and self._is_open():
            self._tell_untold()
            lease = self._next_lease()
            if lease is not None:
                pause_s = _FIRST_POLL_S
                self._run(runner, lease)
            elif may_free():
                runner.stop.wait(pause_s * random.uniform(0.5, 1.0))
                pause_s = min(1.5 * pause_s, _LONGEST_POLL_S)
            else:
                return

    def _is_open(self) -> bool:
        return studies.state(self.study.database, self.study.record.id) == "open"

    def _heed_state(self, stop: StopRequest) -> None:
        if studies.state(self.study.database, self.study.record.id) == "stopped":
            stop.ask(FINISH_RUNS)

    def _run(self, runner: TrialRunner, lease: trial_queue.TrialLease) -> None:
        try:
            runner.run(lease)
        except Interrupted:
            return
        except BaseException as error:
            runner.stop.ask(FINISH_RUNS)
            if isinstance(error, Exception):
                self._check_not_deleted(error)
            raise

    def _check_not_deleted(self, error: Exception) -> None:
        """Say so if the study is gone: what else goes wrong then, in Optuna or here, only follows from it."""
        try:
            studies.state(self.study.database, self.study.record.id)
        except DeletedError as deleted:
            raise deleted from error

    def _next_lease(self) -> trial_queue.TrialLease | None:
        """Return a lease to work on, or ``None`` where there is none now."""
        database, study_id = self.study.database, self.study.record.id
        adopted = trial_queue.adopt_stale(database, study_id, self.worker, self.grace_s)
        if adopted is not None:
            return adopted
        return trial_queue.lease_trial(database, study_id, self.study.budget, self.worker)

    def _tell_untold(self) -> None:
        """Tell Optuna the end of trials whose worker died between storing and telling it."""
        for trial in trials.untold(self.study.database, self.study.record.id):
            if trial.optuna_number is not None and trial.value is not None:
                optuna_trials.tell(self.study.optuna_study, trial.optuna_number, trial.value, trial.state)

    def _others_at_work(self) -> bool:
        return trials.counts(self.study.database, self.study.record.id).get("claimed", 0) > 0

    def _is_complete(self) -> bool:
        counts = trials.counts(self.study.database, self.study.record.id)
        return sum(counts.values()) >= self.study.budget and not counts.get("claimed", 0)

    def _close_if_complete(self) -> bool:
        return self._is_complete() and studies.close(self.study.database, self.study.record)
