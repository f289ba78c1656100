"""Measure the best configurations of a study again under noise that the search never saw, and judge them.

The best of many trials looks better than it is: it was chosen for its luck too. Here nominal and the top candidates run
on fresh noise with fresh seeds, on the searched sequences and on those held out, and are compared noise instance by
noise instance. The comparison is group-sequential: it looks at the runs up to four times and ends as soon as the
outcome is clear.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice
from pathlib import Path
from statistics import NormalDist
from types import MappingProxyType
from typing import Any

import numpy as np

from gtf_tune.definition import GtfDefinition
from gtf_tune.errors import DefinitionError
from gtf_tune.gtf.random_effects import clean_runs_apart
from gtf_tune.pipelines import OptionValue
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.store import confirmations, studies, trials
from gtf_tune.store.trials import Trial
from gtf_tune.study.noise.choice import with_noise
from gtf_tune.study.open_study import OpenStudy, folder_of, load_stored_sequence
from gtf_tune.study.outcome.baselines import baseline_trials
from gtf_tune.study.outcome.contradiction import CleanRun
from gtf_tune.study.outcome.judge import Findings, Measured, judge
from gtf_tune.study.outcome.lead import LEAD_KEY, handicapped
from gtf_tune.study.outcome.recommendation import without_feasible_trial
from gtf_tune.study.outcome.verdict import ADOPT, Verdict, verdict_of
from gtf_tune.study.runs.plan import FinishedRun, RunPlanner, SeedSource, run_order
from gtf_tune.study.runs.run_source import RunSource, finished_by_sequence
from gtf_tune.study.scoring.objective import counted_frames, rules_of, score_on, settings_of

DEFAULT_TOP = 3
DEFAULT_RUNS = 16
"""Most noisy runs of each configuration and sequence; `benchmarks/confirmation_power.py` shows what they tell apart."""

_FEWEST_RUNS = 4

MARGINS_KEY = "margins"
"""Where the resolved part of a study keeps by option the share of the score that it has to win; others win 2 %."""

_BOUNDS = {1: 1.960, 2: 2.038, 3: 2.083, 4: 2.113}
"""Constants of Wang and Tsiatis' boundaries with Delta = 1/4, two-sided 5 %, by the number of looks (Biometrics 43,
1987; Jennison and Turnbull, "Group sequential methods", 2000, table 2.9); `tests/study/test_looks.py` simulates them.
"""


@dataclass(frozen=True)
class Look:
    """A look at the first ``noisy_runs`` runs of each configuration; ``significance`` is the two-sided level there."""

    noisy_runs: int
    significance: float


def looks_at(noisy_runs: int) -> tuple[Look, ...]:
    """Return the looks at up to so many noisy runs: every four of them, at most four looks.

    Looking several times finds a difference by luck more often, so each look needs more than 5 %; over all looks,
    equal configurations are told apart in 5 %. `benchmarks/confirmation_power.py` has what that costs and saves.
    """
    count = min(max(noisy_runs // _FEWEST_RUNS, 1), max(_BOUNDS))
    normal = NormalDist()
    return tuple(
        Look(math.ceil(noisy_runs * number / count), 2 * normal.cdf(-_BOUNDS[count] * (number / count) ** -0.25))
        for number in range(1, count + 1)
    )


@dataclass(frozen=True)
class ConfirmationPlan:
    """What is confirmed: which trials, on which sequences by name, with how many noisy runs at most, and which seeds.

    ``baselines`` are compared with nominal like the ``candidates``, by their name.

    ``round`` counts the confirmations of the study from 1. Each has noise of its own; an interrupted one continues with
    the same.
    """

    nominal: Trial
    candidates: tuple[Trial, ...]
    sequences: Mapping[str, ImageSequence]
    noisy_runs: int
    round: int
    baselines: Mapping[str, Trial] = field(default_factory=dict)
    clean_runs: int = 1

    @property
    def compared(self) -> tuple[tuple[str, Trial], ...]:
        """Candidates and baselines, with the name of each baseline; empty where there is nothing to compare."""
        return (*(("", trial) for trial in self.candidates), *self.baselines.items())

    @property
    def num_runs(self) -> int:
        """Runs of all configurations on all sequences, if no look ends it early."""
        each = self.clean_runs + self.noisy_runs
        return (1 + len(self.compared)) * each * len(self.sequences) if self.compared else 0

    @property
    def purpose(self) -> str:
        """Return the text that its seeds are derived from."""
        return f"confirm:{self.round}"


def plan_confirmation(
    study: OpenStudy,
    places: Mapping[str, Path],
    *,
    top: int = DEFAULT_TOP,
    noisy_runs: int = DEFAULT_RUNS,
    chosen: Sequence[Trial] | None = None,
    again: bool = False,
) -> ConfirmationPlan:
    """Return the plan of a confirmation of the study as it stands.

    Candidates are the complete feasible trials with values below nominal's: the best ``top`` with different options, or
    those that were ``chosen``. The baselines of the definition are compared too.
    ``places`` gives the folders of sequences that lie elsewhere on this machine. A plan equal to that of the latest
    confirmation stands for that one, whose runs are there; ``again`` wants other noise.

    Raises
    ------
    DefinitionError
        There are too few noisy runs for a verdict, or no nominal trial is complete.
    StorageError
        No trial is feasible.
    """
    if noisy_runs < _FEWEST_RUNS:
        raise DefinitionError(
            f"a confirmation needs at least {_FEWEST_RUNS} noisy runs, not {noisy_runs}; make more", remedy=("runs",)
        )
    database, name = study.database, study.definition.name
    known = [trial for trial in trials.of_study(database, study.record.id) if trial.state == "complete"]
    nominal = next((trial for trial in known if trial.number == 0), None)
    if nominal is None:
        raise DefinitionError(f"study '{name}' has no complete nominal trial; run it first", remedy=("run", name))
    if not any(trial.feasible for trial in known):
        raise without_feasible_trial(database, study.record)
    earlier = confirmations.of_study(database, study.record.id)
    lead = study.record.resolved.get(LEAD_KEY, {})
    candidates = best_candidates(known, nominal, top, lead) if chosen is None else tuple(chosen)
    baselines = {
        label: trial
        for label, trial in baseline_trials(study.definition, nominal).items()
        if all(trial.options != other.options for other in (nominal, *candidates))
    }
    sequences = _all_sequences(study, places)
    clean = study.definition.gtf.clean_runs
    plan = ConfirmationPlan(nominal, candidates, sequences, noisy_runs, len(earlier) + 1, baselines, clean)
    if earlier and not again and _scope(study, plan).items() <= earlier[-1].definition.items():
        return replace(plan, round=len(earlier))
    return plan


def confirm(study: OpenStudy, plan: ConfirmationPlan, source: RunSource) -> Verdict:
    """Run a plan, judge the candidates, store the verdict and return it; one that is stored already stays as it is.

    Raises
    ------
    Interrupted
        Someone asked to stop; finished runs are stored, and the next call continues with them.
    """
    study = with_noise(study, plan.sequences, source, plan.purpose)
    fresh = _FreshRuns(study, plan, source)
    holdouts = frozenset(plan.sequences) - frozenset(study.sequences)
    margins, rules = study.record.resolved.get(MARGINS_KEY, {}), rules_of(study.record)
    verdict = judge(Findings(None, (), holdouts), study.definition.gtf)
    remaining = list(plan.compared)
    for look in looks_at(plan.noisy_runs) if remaining else ():
        first, *others = fresh.measured([("", plan.nominal), *remaining], look.noisy_runs)
        findings = Findings(first, tuple(others), holdouts, rules, margins)
        verdict = replace(
            judge(findings, study.definition.gtf, look.significance),
            noisy_runs=look.noisy_runs,
            set_aside=fresh.set_aside_text,
        )
        dropped = {found.number for found in verdict.candidates if found.improvement.value <= 0}
        remaining = [(label, trial) for label, trial in remaining if trial.number not in dropped]
        if verdict.word == ADOPT or not remaining:
            break
    definition = {**_scope(study, plan), "purpose": plan.purpose, "run_keys": fresh.keys}
    stored = confirmations.add(study.database, study.record.id, definition, verdict.as_json(), verdict.word)
    return verdict_of(stored)


def _scope(study: OpenStudy, plan: ConfirmationPlan) -> dict[str, Any]:
    """Return what is confirmed, as it is stored."""
    return {
        "ordinals": [plan.nominal.number, *(trial.number for _, trial in plan.compared)],
        "sequences": list(plan.sequences),
        "clean_runs": study.definition.gtf.clean_runs,
        "noisy_runs": plan.noisy_runs,
    }


def best_candidates(
    known: Sequence[Trial], nominal: Trial, top: int, lead: Mapping[str, Any] = MappingProxyType({})
) -> tuple[Trial, ...]:
    """Return the best ``top`` of some complete trials that beat nominal, with different options.

    ``lead`` is what the study resolved under `LEAD_KEY`: others stand before the leading trial by its margin only.
    """
    better = [trial for trial in known if trial.number and trial.feasible and trial.value is not None and trial.options]
    if nominal.feasible and nominal.value is not None:
        better = [trial for trial in better if trial.value is not None and trial.value < nominal.value]
    chosen: list[Trial] = []
    for trial in sorted(better, key=lambda trial: (handicapped(trial, lead), trial.number)):
        if len(chosen) < top and all(trial.options != other.options for other in (nominal, *chosen)):
            chosen.append(trial)
    return tuple(chosen)


def _all_sequences(study: OpenStudy, places: Mapping[str, Path]) -> dict[str, ImageSequence]:
    """Return the searched sequences and those held out, checked to be what the study began with."""
    stored = {record.name: record for record in studies.sequences(study.database, study.record.id)}
    found = dict(study.sequences)
    for sequence in study.definition.sequences:
        if sequence.holdout:
            root = Path(study.record.root)
            found[sequence.name], _ = load_stored_sequence(
                sequence, stored[sequence.name], folder_of(sequence, root, places)
            )
    return found


@dataclass
class _FreshRuns:
    """Runs of a confirmation so far.

    A configuration that a look dropped keeps the runs that it had. ``aside`` are the clean runs, by sequence, that fell
    into another solution under every configuration alike: they say nothing about the choice, and others are drawn for
    them. ``frames`` are those by which runs on a sequence are scored, by nominal's runs of the first look.
    """

    study: OpenStudy
    plan: ConfirmationPlan
    source: RunSource
    keys: list[str] = field(default_factory=list)
    aside: dict[str, frozenset[int]] = field(default_factory=dict)
    frames: dict[str, frozenset[int] | None] = field(default_factory=dict)
    known: dict[int, Measured] = field(default_factory=dict)

    def measured(self, configurations: Sequence[tuple[str, Trial]], noisy_runs: int) -> list[Measured]:
        """Return nominal and all that is compared with it; of these configurations, with so many noisy runs."""
        finished = self._obtain(configurations, noisy_runs)
        if not self.known:
            self.aside = {name: self._diverged(finished, name) for name in self.plan.sequences}
            if any(self.aside.values()):
                finished = self._obtain(configurations, noisy_runs)
                self.aside = {name: self._diverged(finished, name) for name in self.plan.sequences}
            if rules_of(self.study.record) > 1:
                nominal = finished_by_sequence(self._sound(finished[0]))
                self.frames = {name: counted_frames(runs) for name, runs in nominal.items()}
        gtf = self.study.definition.gtf
        for (label, trial), runs in zip(configurations, finished, strict=True):
            found = measured(trial.number, trial.options or {}, self._sound(runs), gtf, self.frames)
            self.known[trial.number] = replace(found, baseline=label)
        return list(self.known.values())

    @property
    def set_aside_text(self) -> tuple[str, ...]:
        """What was set aside, one sentence for each sequence."""
        return tuple(
            f"{len(runs)} of {self._clean_runs(name)} clean runs on {name} fell into another solution under every "
            f"configuration alike and {'was' if len(runs) == 1 else 'were'} set aside"
            for name, runs in self.aside.items()
            if runs
        )

    def _clean_runs(self, sequence: str) -> int:
        return self.plan.clean_runs + len(self.aside.get(sequence, ()))

    def _obtain(self, configurations: Sequence[tuple[str, Trial]], noisy_runs: int) -> list[list[FinishedRun]]:
        requests = [self._requests(trial.options or {}, noisy_runs) for _, trial in configurations]
        finished = iter(self.source.obtain([request for some in requests for request in some]))
        found = [list(islice(finished, len(some))) for some in requests]
        self.keys = list(dict.fromkeys([*self.keys, *(run.stored.key for runs in found for run in runs)]))
        return found

    def _requests(self, options: Mapping[str, OptionValue], noisy_runs: int) -> list[RunRequest]:
        definition = self.study.definition
        # Configurations are compared under the same noise, even where the search drew it anew for every trial.
        gtf = definition.gtf.model_copy(update={"common_noise": True})
        seeds = SeedSource(definition.search.seed, purpose=self.plan.purpose)
        planner = RunPlanner(self.study.pipeline, gtf, seeds, definition.fixed_options)
        return [
            planner.request(sequence, options, run, sigma=self.study.sigmas[name], number=0)
            for name, sequence in self.plan.sequences.items()
            for run in run_order(self._clean_runs(name), noisy_runs)
        ]

    def _diverged(self, finished: Sequence[Sequence[FinishedRun]], name: str) -> frozenset[int]:
        settings = settings_of(self.study.definition.gtf)
        scores = [score_on(finished_by_sequence(runs)[name], None, settings) for runs in finished]
        return frozenset(np.flatnonzero(clean_runs_apart([score.matrix for score in scores])).tolist())

    def _sound(self, runs: Sequence[FinishedRun]) -> list[FinishedRun]:
        return [
            run
            for run in runs
            if run.request.kind == "noisy" or run.request.index not in self.aside.get(run.request.sequence.name, ())
        ]


def measured(
    number: int,
    options: Mapping[str, OptionValue],
    finished: Sequence[FinishedRun],
    gtf: GtfDefinition,
    frames: Mapping[str, frozenset[int] | None] = MappingProxyType({}),
) -> Measured:
    """Return the score of one configuration on every sequence, and its clean runs that worked.

    ``frames`` are those by which runs on a sequence are scored; all where it has none.
    """
    scores = {
        name: score_on(runs, frames.get(name), settings_of(gtf))
        for name, runs in finished_by_sequence(finished).items()
    }
    clean = {
        name: tuple(
            _clean_run(run)
            for run in finished
            if run.request.sequence.name == name and run.request.kind == "clean" and len(run.trajectory)
        )
        for name in scores
    }
    return Measured(number, options, scores, clean)


def _clean_run(run: FinishedRun) -> CleanRun:
    said = run.stored.diagnostics
    return CleanRun(
        run.trajectory, float(said.get("num_points3D", math.nan)), float(said.get("mean_track_length", math.nan))
    )
