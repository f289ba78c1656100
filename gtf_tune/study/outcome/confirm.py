"""Measure the best configurations of a study again under noise that the search never saw, and judge them.

The best of many trials looks better than it is: it was chosen for its luck too. Here nominal and the top candidates run
on fresh noise with fresh seeds, on the searched sequences and on those held out, and are compared noise instance by
noise instance.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from gtf_tune.definition import GtfDefinition
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import OptionValue
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.store import confirmations, studies, trials
from gtf_tune.store.trials import Trial
from gtf_tune.study.noise.ladder import with_noise
from gtf_tune.study.open_study import OpenStudy, folder_of, load_stored_sequence
from gtf_tune.study.outcome.baselines import baseline_trials
from gtf_tune.study.outcome.contradiction import CleanRun
from gtf_tune.study.outcome.judge import Findings, Measured, judge
from gtf_tune.study.outcome.recommendation import without_feasible_trial
from gtf_tune.study.outcome.verdict import Verdict, verdict_of
from gtf_tune.study.runs.plan import FinishedRun, RunPlanner, SeedSource, run_order
from gtf_tune.study.runs.run_source import RunSource, finished_by_sequence
from gtf_tune.study.scoring.objective import counted_frames, rules_of, score_on, settings_of

DEFAULT_TOP = 3
DEFAULT_RUNS = 16
"""Noisy runs of each configuration and sequence; benchmarks/confirmation_power.py shows what they can tell apart."""

_FEWEST_RUNS = 4

MARGINS_KEY = "margins"
"""Where the resolved part of a study keeps by option the share of the score that it has to win; others win 2 %."""


@dataclass(frozen=True)
class ConfirmationPlan:
    """What is confirmed: which trials, on which sequences by name, with how many noisy runs each, and which seeds.

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
        """Runs of all configurations on all sequences."""
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
    candidates = best_candidates(known, nominal, top) if chosen is None else tuple(chosen)
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
    study = with_noise(study, plan.sequences, source)
    keys: list[str] = []
    found: list[Measured] = []
    frames: dict[str, frozenset[int] | None] = {}
    for label, trial in (("", plan.nominal), *plan.compared) if plan.compared else ():
        finished = source.obtain(_requests(study, plan, trial.options or {}))
        if not found and rules_of(study.record) > 1:
            frames = {name: counted_frames(runs) for name, runs in finished_by_sequence(finished).items()}
        of_trial = measured(trial.number, trial.options or {}, finished, study.definition.gtf, frames)
        found.append(replace(of_trial, baseline=label))
        keys += [run.stored.key for run in finished]
    holdouts = frozenset(plan.sequences) - frozenset(study.sequences)
    margins, rules = study.record.resolved.get(MARGINS_KEY, {}), rules_of(study.record)
    findings = Findings(found[0] if found else None, tuple(found[1:]), holdouts, rules, margins)
    verdict = replace(judge(findings, study.definition.gtf), noisy_runs=plan.noisy_runs)
    definition = {**_scope(study, plan), "purpose": plan.purpose, "run_keys": keys}
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


def best_candidates(known: Sequence[Trial], nominal: Trial, top: int) -> tuple[Trial, ...]:
    """Return the best ``top`` of some complete trials that beat nominal, with different options."""
    better = [trial for trial in known if trial.number and trial.feasible and trial.value is not None and trial.options]
    if nominal.feasible and nominal.value is not None:
        better = [trial for trial in better if trial.value is not None and trial.value < nominal.value]
    chosen: list[Trial] = []
    for trial in sorted(better, key=lambda trial: (trial.value, trial.number)):
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


def _requests(study: OpenStudy, plan: ConfirmationPlan, options: Mapping[str, OptionValue]) -> list[RunRequest]:
    definition = study.definition
    # Configurations are compared under the same noise, even where the search drew it anew for every trial.
    gtf = definition.gtf.model_copy(update={"common_noise": True})
    seeds = SeedSource(definition.search.seed, purpose=plan.purpose)
    planner = RunPlanner(study.pipeline, gtf, seeds, definition.fixed_options)
    return [
        planner.request(sequence, options, run, sigma=study.sigmas[name], number=0)
        for name, sequence in plan.sequences.items()
        for run in run_order(gtf.clean_runs, plan.noisy_runs)
    ]
