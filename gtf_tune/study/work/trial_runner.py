"""Run one trial, from its lease to its stored result."""

import itertools
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace

from optuna.exceptions import UpdateFinishedTrialError
from optuna.trial import Trial

from gtf_tune.execution import Executor
from gtf_tune.pipelines import OptionValue
from gtf_tune.store import runs, trial_queue
from gtf_tune.store.enqueued import enqueued_numbers
from gtf_tune.store.optuna import trials as optuna_trials
from gtf_tune.store.optuna.retrying_storage import gathered
from gtf_tune.store.optuna.tables import with_optuna
from gtf_tune.store.runs import TrialRun
from gtf_tune.store.trial_queue import TrialLease, TrialResult
from gtf_tune.study.events import Callback, TrialFinished, TrialStarted
from gtf_tune.study.ground_truth.record import record_side_metric
from gtf_tune.study.noise.ladder import with_noise
from gtf_tune.study.open_study import OpenStudy
from gtf_tune.study.runs.run_source import Interrupted, RunSource, run_limits
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.scoring.early_stopping import Decision, Sizing
from gtf_tune.study.scoring.trial_scorer import ScoredTrial, TrialScorer, read_reference
from gtf_tune.study.search.samplers import make_sampler
from gtf_tune.study.work.heartbeat import Heartbeat
from gtf_tune.study.work.trial_record import (
    improvement_on_nominal,
    report_instances,
    set_attributes,
    trial_result,
)


@dataclass(frozen=True)
class TrialRunner:
    """Run trials of one study; safe to use from several threads."""

    study: OpenStudy
    executor: Executor
    sizing: Sizing
    stop: StopRequest
    on_event: Callback
    heartbeat: Heartbeat
    ask_lock: threading.Lock

    def run(self, lease: TrialLease) -> None:
        """Run a leased trial to its end.

        Whatever goes wrong on the way, finished runs are stored, and the trial is released for the next worker.

        Raises
        ------
        Interrupted
            Someone asked to stop, or another worker has taken the trial over.
        """
        stop = StopRequest(self.stop)
        self.heartbeat.hold(lease, stop)
        try:
            end = self._run(lease, stop)
        except UpdateFinishedTrialError as error:  # another worker took it over, or someone ended it with Optuna
            trial_queue.release(self.study.database, lease)
            raise Interrupted from error
        except BaseException:
            trial_queue.release(self.study.database, lease)
            raise
        finally:
            self.heartbeat.drop(lease)
        self.on_event(end)

    def _run(self, lease: TrialLease, stop: StopRequest) -> TrialFinished:
        started = time.perf_counter()
        trial, options = self._ask(lease)
        reference = read_reference(self.study, lease.number)
        source = RunSource(
            self.study.database,
            self.executor,
            run_limits(self.study.definition.limits),
            stop,
            self.on_event,
            self.study.nominal_run,
        )
        study = with_noise(self.study, self.study.sequences, source)
        scored = self._score(trial, TrialScorer(study, source, options, lease.number, reference))
        return self._record(lease, trial, scored, time.perf_counter() - started)

    def _record(self, lease: TrialLease, trial: Trial, scored: ScoredTrial, wall_s: float) -> TrialFinished:
        """Store the result of a trial, in our tables and in Optuna's."""
        study, database = self.study, self.study.database
        if not trial_queue.is_held(database, lease):
            raise Interrupted
        runs.link(database, lease.trial_id, _used(lease, scored))
        improvement = improvement_on_nominal(scored)
        with gathered(trial.storage):
            set_attributes(trial, scored, improvement, wall_s)
            record_side_metric(study, lease, trial, scored)
            if study.mismatch:
                trial.set_user_attr("version", study.pipeline.version)
        result = trial_result(scored, improvement, wall_s)
        if study.mismatch:
            result = replace(result, detail={**result.detail, "version_mismatch": study.mismatch})
        if not trial_queue.finish(database, lease, result):
            raise Interrupted
        self._announce_end(trial, lease.number, result)
        optuna_trials.tell(study.optuna_study, trial.number, scored.score.value, result.state)
        return TrialFinished(lease.number, scored.options, result, improvement)

    def _ask(self, lease: TrialLease) -> tuple[Trial, dict[str, OptionValue]]:
        study = self.study.optuna_study
        with self.ask_lock:
            position = self._position(lease.number)
            study.sampler = make_sampler(self.study.definition.search, position, self.study.space)
            trial_id = lease.optuna_trial_id
            if trial_id is None or optuna_trials.is_finished(study, trial_id):
                trial_id = with_optuna(self.study.database, lambda: self._create(lease))
            else:
                study.get_trials(deepcopy=False)  # or Optuna's cache would not know a trial that was created elsewhere
            trial = optuna_trials.start(study, trial_id)
            # All of its options at once: of some alone, whoever takes the trial over would draw others for the rest.
            with gathered(trial.storage):
                options = self.study.space.suggest(trial)
        if not trial_queue.attach_optuna_trial(self.study.database, lease, trial_id, trial.number, options):
            raise Interrupted
        gtf = self.study.definition.gtf
        planned = (gtf.clean_runs + self.sizing.first(is_nominal=lease.number == 0)) * len(self.study.sequences)
        self.on_event(TrialStarted(lease.number, options, planned))
        return trial, options

    def _announce_end(self, trial: Trial, number: int, result: TrialResult) -> None:
        """Let a sampler that gtf-tune does not know take note of the end of a trial, before Optuna is told of it."""
        search = self.study.definition.search
        if search.is_foreign and result.value is not None:
            sampler = make_sampler(search, self._position(number), self.study.space)
            state = optuna_trials.STATES[result.state]
            sampler.after_trial(self.study.optuna_study, optuna_trials.known(trial), state, [result.value])

    def _create(self, lease: TrialLease) -> int:
        """Create the Optuna trial of a lease: another one with the same options where someone else has ended the first.

        Whoever opens the storage with Optuna may do so: `optuna tell` ends a trial of a dead process there.
        """
        fixed = self._fixed(lease.number) if lease.options is None else lease.options
        return optuna_trials.create_for_number(self.study.optuna_study, lease.number, fixed)

    def _fixed(self, number: int) -> Mapping[str, OptionValue] | None:
        """Return the values that a trial must take: nominal for trial 0, then the points of a grid."""
        space = self.study.space
        if number == 0:
            return space.nominal
        if self.study.definition.search.sampler != "grid":
            return None
        return next(itertools.islice(space.grid(), self._position(number) - 1, None), None)

    def _position(self, number: int) -> int:
        """Return which trial of the search a trial is: those that were enqueued before it take no place in it."""
        before = [one for one in enqueued_numbers(self.study.database, self.study.record.id) if one < number]
        return number - len(before)

    def _score(self, trial: Trial, scorer: TrialScorer) -> ScoredTrial:
        """Score clean runs, then noisy ones as the sizing asks for them; stop as soon as the trial is infeasible."""
        scored = scorer.score(noisy_runs=0)
        count = self.sizing.first(is_nominal=scorer.number == 0)
        while scored.score.feasible:
            scored = scorer.score(noisy_runs=count)
            report_instances(trial, scored)
            decision = self._decide(trial, scored)
            scored = replace(scored, decision=decision)
            if decision.noisy_runs <= count:
                break
            count = decision.noisy_runs
        return scored

    def _decide(self, trial: Trial, scored: ScoredTrial) -> Decision:
        decision = self.sizing.next(scored.instances, scored.reference.incumbent)
        count = len(scored.instances)
        asks = self.study.definition.search.pruner != "none"
        if asks and decision.noisy_runs > count and trial.should_prune():
            return Decision(count, f"Optuna's pruner gave the trial up after {count} noisy runs", hopeless=True)
        return decision


def _used(lease: TrialLease, scored: ScoredTrial) -> list[TrialRun]:
    return [TrialRun(lease.number, run.request.sequence.name, run.stored, run.reused) for run in scored.runs]
