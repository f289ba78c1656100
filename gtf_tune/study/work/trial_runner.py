"""Run one trial, from its lease to its stored result."""

import itertools
import math
import platform
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

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
from gtf_tune.store.trials import MADE_BY_KEY
from gtf_tune.study.events import Callback, TrialFinished, TrialSetAside, TrialStarted
from gtf_tune.study.ground_truth.record import record_side_metric
from gtf_tune.study.noise.choice import with_noise
from gtf_tune.study.open_study import OpenStudy
from gtf_tune.study.outcome.improvement import (
    UNKNOWN_IMPROVEMENT,
    Improvement,
    paired_improvement,
    score_matrices,
    stored_matrices,
)
from gtf_tune.study.runs.run_source import Interrupted, NothingWorksError, RunSource, SequenceRuns, run_limits
from gtf_tune.study.runs.stop import StopRequest
from gtf_tune.study.scoring.objective import SequenceScore, made_by
from gtf_tune.study.scoring.trial_scorer import ScoredTrial, TrialScorer, read_reference
from gtf_tune.study.search.samplers import make_sampler
from gtf_tune.study.work.heartbeat import Heartbeat


@dataclass(frozen=True)
class TrialRunner:
    """Run trials of one study; safe to use from several threads."""

    study: OpenStudy
    executor: Executor
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
            Someone asked to stop, another worker has taken the trial over, or it is left to another machine.
        """
        stop = StopRequest(self.stop)
        self.heartbeat.hold(lease, stop)
        try:
            end = self._run(lease, stop)
        except UpdateFinishedTrialError as error:  # another worker took it over, or someone ended it with Optuna
            trial_queue.release(self.study.database, lease)
            raise Interrupted from error
        except NothingWorksError as error:
            trial_queue.set_aside(self.study.database, lease, f"nothing worked on {platform.node()}: {error}")
            self.on_event(TrialSetAside(lease.number, str(error)))
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
            doubts_failures=lease.number == 0 and self.study.database.is_shared and not lease.set_aside,
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
        noted = {"version_mismatch": study.mismatch} if study.mismatch else {}
        result = replace(result, detail={**result.detail, MADE_BY_KEY: made_by(study.record), **noted})
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
        planned = (gtf.clean_runs + gtf.noisy_runs_max) * len(self.study.sequences)
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
        before = [other for other in enqueued_numbers(self.study.database, self.study.record.id) if other < number]
        return number - len(before)

    def _score(self, trial: Trial, scorer: TrialScorer) -> ScoredTrial:
        """Score the clean runs, then the noisy ones too unless the trial is infeasible already."""
        scored = scorer.score(noisy_runs=0)
        if scored.score.feasible:
            scored = scorer.score(noisy_runs=self.study.definition.gtf.noisy_runs_max)
            report_instances(trial, scored)
        return scored


def _used(lease: TrialLease, scored: ScoredTrial) -> list[TrialRun]:
    return [TrialRun(lease.number, run.request.sequence.name, run.stored, run.reused) for run in scored.runs]


COVERAGE_CONSTRAINT = "coverage"


def report_instances(trial: Trial, scored: ScoredTrial) -> None:
    """Report the value of each new noisy instance as an intermediate value, its number being the step."""
    known = len(optuna_trials.known(trial).intermediate_values)
    with gathered(trial.storage):
        for step, value in enumerate(scored.instances[known:], start=known):
            trial.report(value, step)


def improvement_on_nominal(scored: ScoredTrial) -> Improvement:
    """Return the paired improvement of a trial; unknown for nominal itself and where one of the two is infeasible."""
    if scored.reference.nominal_value is None:
        return UNKNOWN_IMPROVEMENT
    return paired_improvement(stored_matrices(scored.reference.nominal_detail), score_matrices(scored.score))


def set_attributes(trial: Trial, scored: ScoredTrial, improvement: Improvement, wall_s: float) -> None:
    """Give Optuna the constraint and the headline numbers: short scalars, absent where they do not exist.

    ``improvement_percent`` is the paired improvement, positive where the trial is better than nominal.
    """
    # A trial that an earlier worker nearly finished has the constraint already; Optuna would warn of a second one.
    if COVERAGE_CONSTRAINT not in optuna_trials.known(trial).constraints:
        trial.set_constraint(COVERAGE_CONSTRAINT, scored.score.violation)
    for name, value in _attributes(scored, improvement, wall_s).items():
        trial.set_user_attr(name, value)


def _attributes(scored: ScoredTrial, improvement: Improvement, wall_s: float) -> dict[str, Any]:
    score = scored.score
    attributes: dict[str, Any] = {
        "coverage": round(score.coverage, 4),
        "noisy_runs": scored.noisy_runs,
        "wall_s": round(wall_s, 1),
    }
    if score.feasible:
        attributes["gtf_ate"] = score.value
        if math.isfinite(score.standard_error):
            attributes["gtf_se"] = score.standard_error
        if improvement.is_known:
            attributes["improvement_percent"] = round(100 * improvement.value, 2)
    return attributes


def trial_result(scored: ScoredTrial, improvement: Improvement, wall_s: float) -> TrialResult:
    """Return the row of a trial, its matrices included."""
    score = scored.score
    low, high = score.confidence_interval
    by_sequence = {
        name: _sequence_detail(sequence, scored.by_sequence[name]) for name, sequence in score.by_sequence.items()
    }
    return TrialResult(
        state="complete",
        value=score.value,
        feasible=score.feasible,
        gtf_ate=score.value if score.feasible else None,
        standard_error=_known(score.standard_error),
        ci_low=_known(low),
        ci_high=_known(high),
        coverage=score.coverage,
        collapsed_rate=_known(score.collapse_rate),
        clean_runs=sum(run.request.kind == "clean" for run in scored.runs),
        noisy_runs=sum(run.request.kind == "noisy" for run in scored.runs),
        wall_s=wall_s,
        message=score.message,
        detail={
            "sequences": by_sequence,
            "instances": list(scored.instances),
            "improvement": improvement.as_json(),
        },
    )


def _sequence_detail(found: SequenceScore, runs: SequenceRuns) -> dict[str, Any]:
    detail: dict[str, Any] = {
        "value": None,
        "coverage": found.coverage,
        "coverage_nominal": min(runs.clean_coverage),
        "message": found.message,
    }
    if found.score is None:
        return detail
    score = found.score
    return detail | {
        "value": _known(score.value) if found.feasible else None,
        "standard_error": _known(score.standard_error),
        "ci": [_known(bound) for bound in score.confidence_interval],
        "matrix": [[_known(value) for value in row] for row in score.matrix.tolist()],
        "pair_errors": {f"{i},{j}": reason for (i, j), reason in score.pair_errors.items()},
        "coverage_clean": score.coverage_clean.tolist(),
        "coverage_noisy": score.coverage_noisy.tolist(),
        "collapsed": score.collapsed.tolist(),
        "extent": _known(score.extent),
        **({} if found.counted is None else {"counted_frames": found.counted}),
    }


def _known(value: float) -> float | None:
    return value if math.isfinite(value) else None
