"""The phases of tuning once a study exists: search, shorten what was found, confirm it; within the minutes, if any.

The command line and Python go the same way.
"""

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

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
from gtf_tune.study.outcome.recommendation import UNCONFIRMED, Recommendation, recommend
from gtf_tune.study.runs.run_source import RunSource, run_limits
from gtf_tune.study.runs.stop import FINISH_RUNS, StopRequest
from gtf_tune.study.tune.ablation import shortened
from gtf_tune.study.tune.budget import CONFIRMED, FEWEST_CONFIRMATION_RUNS, Budget, Plan, RunPrice
from gtf_tune.study.tune.pace import Pace, work_of
from gtf_tune.study.work.worker import StudyWorker

_RESERVE = 0.97
"""Share of the time before the deadline that runs may fill."""


@dataclass(frozen=True)
class Minutes:
    """What was planned for a study, what is affordable, and how fast it goes."""

    plan: Plan
    budget: Budget
    pace: Pace

    def price(self) -> RunPrice:
        """Return what a run costs here, as planned but for the pace that was seen."""
        slower, planned = self.pace.slowness, self.plan.price
        return RunPrice(slower * planned.whole_s, slower * planned.repeated_s, slower * planned.verified_s)

    @property
    def free_s(self) -> float:
        """Seconds until the models have to be written."""
        return _RESERVE * self.pace.deadline_left_s - self.pace.slowness * self.plan.write_s

    def search_is_over(self, trials_done: int) -> bool:
        """Whether there is no time for a further trial.

        Beyond the first configurations a search leaves time for a confirmation, if only a short one.
        """
        price = self.price()
        least = FEWEST_CONFIRMATION_RUNS if trials_done > self.budget.first else 0
        return self.free_s - self.budget.confirmation_s(price, least) < self.budget.trial_s(price)

    def confirmation_runs(self) -> int:
        """Return how many noisy runs a confirmation may have now; 0 where there is no time for one."""
        return self.budget.affordable_confirmation(self.price(), self.free_s)


def minutes_of(study: OpenStudy, plan: Plan, jobs: int, left_s: float) -> Minutes:
    """Return what may be done in the seconds that are left for a study."""
    search = study.definition.search
    budget = Budget(left_s, jobs, len(search.first), len(search.baselines))
    return Minutes(plan, budget, Pace(work_of(plan, budget.baselines), jobs, left_s))


@dataclass(frozen=True)
class Means:
    """What the phases work with.

    ``minutes`` is None where the number of trials decides alone. ``announce`` gets a sentence at the beginning of each
    phase, ``callbacks`` every event.
    """

    executor: Executor
    stop: StopRequest
    callbacks: Sequence[Callback] = ()
    announce: Callable[[str], None] = lambda _: None
    minutes: Minutes | None = None


def tune_through(study: OpenStudy, means: Means) -> Recommendation:
    """Search, put options that carry nothing back to nominal, confirm, and return which trial to use.

    What was done before is not done again: within minutes, a study that is confirmed is not searched any more.

    Raises
    ------
    Interrupted
        Someone asked to stop; the next call goes on.
    """
    if means.minutes is None or not confirmations.of_study(study.database, study.record.id):
        _search(study, means)
        if not means.stop.level and not recommend(study.database, study.record).is_confirmed:
            _confirm(study, means, _candidates(study, means))
    return recommend(study.database, study.record)


def _search(study: OpenStudy, means: Means) -> None:
    """Run the trials of the study, as many as there is time for."""
    stop, done = StopRequest(means.stop), itertools.count(1)

    def watch(event: Event) -> None:
        if isinstance(event, RunFinished) and means.minutes:
            means.minutes.pace.run_done(reused=event.run.reused)
        if isinstance(event, TrialFinished) and means.minutes and means.minutes.search_is_over(next(done)):
            stop.ask(FINISH_RUNS)

    StudyWorker(study, means.executor, stop, [watch, *means.callbacks]).work()


def _candidates(study: OpenStudy, means: Means) -> tuple[Trial, ...]:
    """Return the trials to confirm: the best one, as short as it can be, and the next best."""
    top = CONFIRMED if means.minutes else DEFAULT_TOP
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
    if means.stop.level or (means.minutes and means.minutes.search_is_over(means.minutes.budget.most_trials)):
        return None
    number = enqueue(study.database, study.definition.name, options)
    StudyWorker(study, means.executor, means.stop, means.callbacks).work()
    found = next(trial for trial in trials.of_study(study.database, study.record.id) if trial.number == number)
    return found if found.state == "complete" else None


def _confirm(study: OpenStudy, means: Means, chosen: Sequence[Trial]) -> None:
    noisy = means.minutes.confirmation_runs() if means.minutes else DEFAULT_RUNS
    if not noisy:
        means.announce("there is no time left to confirm the outcome; give more minutes for that")
        return
    plan = plan_confirmation(study, {}, noisy_runs=noisy, chosen=chosen)
    if plan.compared:
        means.announce(f"confirm: nominal and {len(plan.compared)} more on fresh noise, {noisy} noisy runs each")
    if means.minutes:
        means.minutes.pace.begin("confirm")

    def watch(event: Event) -> None:
        if isinstance(event, RunFinished) and means.minutes:
            means.minutes.pace.run_done(reused=event.run.reused)
        for callback in means.callbacks:
            callback(event)

    limits = run_limits(study.definition.limits)
    source = RunSource(study.database, means.executor, limits, means.stop, watch, study.nominal_run)
    confirm(study, plan, source)
