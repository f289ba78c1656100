"""Work on a study until its budget is spent: lease a trial, let the sampler choose, run, score, record."""

import random
import threading
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass, field

from gtf_tune.errors import DeletedError, OptionError, StorageError, numbered
from gtf_tune.execution import Executor
from gtf_tune.store import enqueued, studies, trial_queue, trials
from gtf_tune.store.enqueued import enqueued_numbers
from gtf_tune.store.optuna import trials as optuna_trials
from gtf_tune.store.trial_queue import TrialLease, Worker, this_worker
from gtf_tune.study.events import Callback, Event
from gtf_tune.study.open_study import OpenStudy, trial_budget
from gtf_tune.study.runs.run_source import Interrupted
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest
from gtf_tune.study.scoring.objective import made_by
from gtf_tune.study.search.samplers import make_sampler
from gtf_tune.study.search.space import option_faults
from gtf_tune.study.work.heartbeat import GRACE_S, INTERVAL_S, Heartbeat
from gtf_tune.study.work.trial_runner import TrialRunner

_FIRST_POLL_S = 0.5
_LONGEST_POLL_S = 10.0
_SIGNAL_POLL_S = 0.5


@dataclass(frozen=True)
class StudyWorker:
    """Work on one open study in this process until its budget is spent or someone asks to stop.

    Several workers, on one or many machines, may work on the same study: the database leases each trial to one live
    worker, and the trials of dead workers are adopted with every run that had finished. A worker looks at the state of
    its study before every trial and with every heartbeat: it takes no trial of a paused study, and gives its trial back
    where the study is stopped.

    Parameters
    ----------
    callbacks
        Each gets every event, from the thread that works on the trial.
    beat_s, grace_s
        Seconds between two heartbeats, and seconds of silence after which a worker counts as dead.
    """

    study: OpenStudy
    executor: Executor
    stop: StopRequest = field(default_factory=StopRequest)
    callbacks: Sequence[Callback] = ()
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
        """Work until no trial is free now, and return whether the study is complete.

        Raises
        ------
        GtfTuneError
            This machine cannot go on: its database, disk or images are at fault.
        """
        return self._work(trial_parallel, lambda: False)

    def _work(self, trial_parallel: int, others: Callable[[], bool]) -> bool:
        if not self._is_complete():  # so that no trial is begun that cannot go on
            make_sampler(self.study.definition.search, 0, self.study.space)
        stop = StopRequest(self.stop)
        with (
            Heartbeat(self.study.database, self.beat_s, lambda: self._stop_with_study(stop)) as heartbeat,
            ThreadPoolExecutor(trial_parallel) as pool,
        ):
            runner = TrialRunner(
                study=self.study,
                executor=self.executor,
                stop=stop,
                on_event=self._announce,
                heartbeat=heartbeat,
                ask_lock=threading.Lock(),
            )
            loops = [
                pool.submit(self._run_trials, runner, lambda: heartbeat.holds_any or others())
                for _ in range(trial_parallel)
            ]
            # Not left to the pool, which would wait without end: a signal that reaches another thread (measured, while
            # a process is being started) is only handled when this one wakes up.
            while wait(loops, timeout=_SIGNAL_POLL_S).not_done:
                continue
        for loop in loops:
            loop.result()
        return self._close_if_complete()

    def _announce(self, event: Event) -> None:
        for callback in self.callbacks:
            callback(event)

    def _run_trials(self, runner: TrialRunner, may_come_free: Callable[[], bool]) -> None:
        """Run trials one after the other; where none is free, wait while one ``may_come_free``."""
        pause_s = _FIRST_POLL_S
        while not runner.stop.level and self._is_open():
            self._tell_untold()
            lease = self._next_lease()
            if lease is not None:
                pause_s = _FIRST_POLL_S
                self._run(runner, lease)
            elif may_come_free():
                runner.stop.wait(pause_s * random.uniform(0.5, 1.0))
                pause_s = min(1.5 * pause_s, _LONGEST_POLL_S)
            else:
                return

    def _is_open(self) -> bool:
        """Whether trials may be begun; raise `StorageError` where another program changed how they are scored."""
        database, record = self.study.database, self.study.record
        now = studies.of_id(database, record.id)
        if now.definition != record.definition and made_by(now) != made_by(record):
            raise StorageError(
                f"the definition of study '{now.name}' was changed while it was worked on, so that new trials would be "
                "scored otherwise; restore it, or create a new study"
            )
        return now.state == "open"

    def _stop_with_study(self, stop: StopRequest) -> None:
        if studies.state(self.study.database, self.study.record.id) == "stopped":
            stop.ask(FINISH_RUNS)

    def _run(self, runner: TrialRunner, lease: TrialLease) -> None:
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
        """Raise `DeletedError` if the study is gone: any other error, in Optuna or here, only follows from that."""
        try:
            studies.state(self.study.database, self.study.record.id)
        except DeletedError as deleted:
            raise deleted from error

    def _next_lease(self) -> TrialLease | None:
        """Return a trial to work on, or ``None`` where none is free now."""
        database, study_id = self.study.database, self.study.record.id
        adopt_waiting(self.study)
        adopted = trial_queue.adopt_stale(database, study_id, self.worker, self.grace_s)
        if adopted is not None:
            return adopted
        return trial_queue.lease_trial(database, study_id, self._searched, self.worker)

    def _tell_untold(self) -> None:
        """Give Optuna the results of trials whose worker died after storing them, before telling Optuna."""
        for trial in trials.untold(self.study.database, self.study.record.id):
            if trial.optuna_number is not None and trial.value is not None:
                optuna_trials.tell(self.study.optuna_study, trial.optuna_number, trial.value, trial.state)

    def _others_at_work(self) -> bool:
        return trials.counts(self.study.database, self.study.record.id).get("claimed", 0) > 0

    @property
    def _searched(self) -> int:
        return trial_budget(self.study.definition, self.study.space)

    def _is_complete(self) -> bool:
        database, study_id = self.study.database, self.study.record.id
        counts = trials.counts(database, study_id)
        budget = self._searched + len(enqueued_numbers(database, study_id))
        return sum(counts.values()) >= budget and not counts.get("claimed", 0)

    def _close_if_complete(self) -> bool:
        return self._is_complete() and studies.close(self.study.database, self.study.record)


def adopt_waiting(study: OpenStudy) -> None:
    """Append the trials that wait in Optuna's queue to a study, whose budget grows by as many.

    The sampler chooses what they leave open, as Optuna itself has it. A trial with options that the study cannot have
    fails at once; its user attribute ``refused`` says why.
    """
    for waiting in enqueued.waiting_in_optuna(study.database, study.record):
        faults = _faults(study, optuna_trials.fixed_options(study.optuna_study, waiting.id))
        if faults:
            optuna_trials.refuse(study.optuna_study, waiting.id, numbered(faults))
        else:
            enqueued.adopt(study.database, study.record.id, waiting)


def _faults(study: OpenStudy, options: Mapping[str, object]) -> list[str]:
    table = study.pipeline.options
    try:
        return option_faults(study.space, study.definition, table, table.check(options))
    except OptionError as error:
        return [str(error)]
