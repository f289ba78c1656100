"""The phases of tuning once a study exists: search, shorten what was found, confirm it; within the minutes, if any.

The command line and Python go the same way.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from gtf_tune.execution import Executor
from gtf_tune.pipelines import OptionValue
from gtf_tune.store import confirmations, trials
from gtf_tune.store.trials import Trial
from gtf_tune.study.enqueue import enqueue
from gtf_tune.study.events import Callback, Event, RunFinished, TrialFinished
from gtf_tune.study.open_study import OpenStudy
from gtf_tune.study.outcome.confirm import (
    DEFAULT_RUNS,
    DEFAULT_TOP,
    best_candidates,
    confirm,
    plan_confirmation,
)
from gtf_tune.study.outcome.recommendation import NOTHING_FEASIBLE, UNCONFIRMED, Recommendation, recommend
from gtf_tune.study.runs.run_source import RunSource, run_limits
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest
from gtf_tune.study.tune.ablation import shortened
from gtf_tune.study.tune.budget import CONFIRMED, Budget, Plan
from gtf_tune.study.tune.pace import CONFIRM, Pace
from gtf_tune.study.work.worker import StudyWorker


def pace_of(study: OpenStudy, plan: Plan, jobs: int, left_s: float) -> Pace:
    """Return the pace of a study that has a plan and so many seconds left."""
    search = study.definition.search
    budget = Budget(left_s, jobs, len(search.first), len(search.baselines))
    ended = [trial for trial in trials.of_study(study.database, study.record.id) if trial.state == "complete"]
    return Pace(plan, budget, len(ended))


@dataclass(frozen=True)
class Means:
    """What the phases work with.

    ``pace`` is None where the number of trials decides alone. ``announce`` gets a sentence at the beginning of each
    phase, ``callbacks`` every event.
    """

    executor: Executor
    stop: StopRequest
    callbacks: Sequence[Callback] = ()
    announce: Callable[[str], None] = lambda _: None
    pace: Pace | None = None


def tune_through(study: OpenStudy, means: Means) -> Recommendation:
    """Search, put options that carry nothing back to nominal, confirm, and return which trial to use.

    What was done before is not done again: within minutes, a study that is confirmed is not searched any more.

    Raises
    ------
    Interrupted
        Someone asked to stop; the next call goes on.
    """
    if means.pace is None or not confirmations.of_study(study.database, study.record.id):
        _search(study, means)
        found = recommend(study.database, study.record)
        hopeless = means.pace is not None and found.decision == NOTHING_FEASIBLE
        if not (means.stop.level or found.is_confirmed or hopeless):
            _confirm(study, means, _candidates(study, means))
    return recommend(study.database, study.record)


def _search(study: OpenStudy, means: Means) -> None:
    """Run the trials of the study, as many as there is time for."""
    pace, stop = means.pace, StopRequest(means.stop)
    if pace is not None and pace.search_is_over:
        return

    def watch(event: Event) -> None:
        if pace is not None:
            _count(pace, event)
            if isinstance(event, TrialFinished) and pace.search_is_over:
                stop.ask(FINISH_RUNS)

    StudyWorker(study, means.executor, stop, [watch, *means.callbacks]).work()


def _count(pace: Pace, event: Event) -> None:
    if isinstance(event, RunFinished):
        pace.run_done(reused=event.run.reused)
    if isinstance(event, TrialFinished):
        pace.trial_done()


def _candidates(study: OpenStudy, means: Means) -> tuple[Trial, ...]:
    """Return the trials to confirm: the best one, as short as it can be, and the next best."""
    top = CONFIRMED if means.pace else DEFAULT_TOP
    known = [trial for trial in trials.of_study(study.database, study.record.id) if trial.state == "complete"]
    nominal = next((trial for trial in known if trial.number == 0), None)
    best = best_candidates(known, nominal, top) if nominal else ()
    if nominal is None or not best or recommend(study.database, study.record).decision != UNCONFIRMED:
        return best
    short = shortened(study.database, nominal, best[0], lambda options: _try(study, means, options))
    if short.number != best[0].number:
        means.announce(f"trial {short.number} takes the place of trial {best[0].number}: it changes fewer options")
    return (short, *(trial for trial in best[1:] if trial.options != short.options))


def _try(study: OpenStudy, means: Means, options: Mapping[str, OptionValue]) -> Trial | None:
    """Run a trial with these options; return None where there is no time for it or someone asked to stop."""
    pace = means.pace
    if means.stop.level or (pace and not pace.may_shorten):
        return None
    number = enqueue(study.database, study.definition.name, options)
    watch = [lambda event: _count(pace, event)] if pace else []
    StudyWorker(study, means.executor, means.stop, [*watch, *means.callbacks]).work()
    found = next(trial for trial in trials.of_study(study.database, study.record.id) if trial.number == number)
    return found if found.state == "complete" else None


def _confirm(study: OpenStudy, means: Means, chosen: Sequence[Trial]) -> None:
    pace, noisy, baselines = means.pace, DEFAULT_RUNS, True
    if pace:
        ahead = pace.ahead
        noisy, baselines, chosen = ahead.confirmation_runs, ahead.baselines > 0, chosen[: ahead.candidates]
    if not noisy:
        means.announce("there is no time left to confirm the outcome; give more minutes for that")
        return
    plan = plan_confirmation(study, {}, noisy_runs=noisy, chosen=chosen)
    plan = plan if baselines else replace(plan, baselines={})
    if plan.compared:
        means.announce(f"confirm: nominal and {len(plan.compared)} more on fresh noise, {noisy} noisy runs each")
    if pace:
        pace.begin(CONFIRM)

    def watch(event: Event) -> None:
        if pace:
            _count(pace, event)
        for callback in means.callbacks:
            callback(event)

    limits = run_limits(study.definition.limits)
    source = RunSource(study.database, means.executor, limits, means.stop, watch, study.nominal_run)
    confirm(study, plan, source)
