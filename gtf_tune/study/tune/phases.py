"""The phases of tuning once a study exists: search, shorten what was found, confirm it; within the minutes, if any.

The command line and Python go the same way.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from gtf_tune.display import count, duration
from gtf_tune.execution import Executor
from gtf_tune.pipelines import OptionValue
from gtf_tune.store import confirmations, runs, trials
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
from gtf_tune.study.outcome.lead import LEAD_KEY
from gtf_tune.study.outcome.recommendation import NOTHING_FEASIBLE, UNCONFIRMED, Recommendation, recommend
from gtf_tune.study.runs.plan import run_order
from gtf_tune.study.runs.run_source import Interrupted, RunSource, run_limits
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest, stopped_in_time
from gtf_tune.study.tune.ablation import shortened
from gtf_tune.study.tune.budget import CONFIRMED, Budget, Plan
from gtf_tune.study.tune.pace import CONFIRM, Pace
from gtf_tune.study.work.worker import StudyWorker

_FEWEST_INFEASIBLE = 3


def pace_of(study: OpenStudy, plan: Plan, jobs: int, left_s: float) -> Pace:
    """Return the pace of a study that has a plan and so many seconds left."""
    search, gtf = study.definition.search, study.definition.gtf
    ended = [trial for trial in trials.of_study(study.database, study.record.id) if trial.state == "complete"]
    budget = Budget(
        left_s,
        jobs,
        len(search.first),
        len(search.baselines),
        noisy=gtf.noisy_runs_max,
        clean=gtf.clean_runs,
        stored=0 if ended else stored_runs(study),
    )
    return Pace(plan, budget, len(ended))


def stored_runs(study: OpenStudy) -> int:
    """Return how many runs of the nominal trial are stored before it has ended."""
    gtf, planner = study.definition.gtf, study.planner
    requests = [
        planner.request(sequence, study.space.nominal, run, sigma=study.sigmas.get(name, 0.0), number=0)
        for name, sequence in study.sequences.items()
        for run in run_order(gtf.clean_runs, gtf.noisy_runs_max)
    ]
    return len(runs.find(study.database, [request.key for request in requests])) // len(study.sequences)


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
        # A confirmation ends the search for good: it needs something to compare nominal with.
        too_early = means.pace is not None and (found.decision == NOTHING_FEASIBLE or not found.compares)
        if not (means.stop.level or found.is_confirmed or too_early):
            _confirm(study, means, _candidates(study, means))
    return recommend(study.database, study.record)


def _search(study: OpenStudy, means: Means) -> None:
    """Run the trials of the study, as many as there is time for."""
    pace, stop = means.pace, StopRequest(means.stop)
    if pace is None:
        StudyWorker(study, means.executor, stop, means.callbacks).work()
        return
    if pace.search_is_over:
        return
    ahead = pace.ahead
    trials_ahead = count(ahead.trials + (pace.done == 0), "trial")
    means.announce(f"search: {trials_ahead}, about {duration(ahead.search_s)}")

    def watch(event: Event) -> None:
        _count(pace, event)
        ends = isinstance(event, TrialFinished) and (pace.search_is_over or _nothing_works(study))
        if ends or pace.trial_is_hopeless:
            stop.ask(FINISH_RUNS)

    with stopped_in_time(stop, lambda: pace.work_left_s):
        StudyWorker(study, means.executor, stop, [watch, *means.callbacks]).work()


def _nothing_works(study: OpenStudy) -> bool:
    """Whether nominal and the first others are all infeasible: what they share is at fault, and the rest would be."""
    ended = [trial for trial in trials.of_study(study.database, study.record.id) if trial.state == "complete"]
    return len(ended) >= _FEWEST_INFEASIBLE and not any(trial.feasible for trial in ended)


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
    lead = study.record.resolved.get(LEAD_KEY, {})
    best = best_candidates(known, nominal, top, lead) if nominal else ()
    if nominal is None or not best or recommend(study.database, study.record).decision != UNCONFIRMED:
        return best
    short = shortened(study.database, nominal, best[0], lambda options: _try(study, means, options))
    if short.number != best[0].number:
        means.announce(f"trial {short.number} takes the place of trial {best[0].number}: it changes fewer options")
    return (short, *(trial for trial in best[1:] if trial.options != short.options))


def _try(study: OpenStudy, means: Means, options: Mapping[str, OptionValue]) -> Trial | None:
    """Run a trial with these options; return None where there is no time for it or someone asked to stop."""
    pace = means.pace
    known = trials.of_study(study.database, study.record.id)
    waits = any(trial.state == "claimed" for trial in known)  # it would be run first
    if means.stop.level or (pace and (waits or not pace.may_shorten)):
        return None
    number, stop = enqueue(study.database, study.definition.name, options), StopRequest(means.stop)

    def watch(event: Event) -> None:
        if pace:
            _count(pace, event)
        if isinstance(event, TrialFinished) and event.number == number:
            stop.ask(FINISH_RUNS)  # a search that ended for want of time does not go on

    with stopped_in_time(stop, lambda: pace.work_left_s if pace else math.inf):
        StudyWorker(study, means.executor, stop, [watch, *means.callbacks]).work()
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

    limits, stop = run_limits(study.definition.limits), StopRequest(means.stop)
    source = RunSource(study.database, means.executor, limits, stop, watch, study.nominal_run)
    try:
        with stopped_in_time(stop, lambda: pace.work_left_s if pace else math.inf):
            confirm(study, plan, source)
    except Interrupted:
        if means.stop.level:
            raise
        means.announce("the time is up before the confirmation has ended; its runs are kept for the same command")
