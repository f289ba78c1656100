"""Check whether options that were adopted elsewhere hold on a sequence, with as few runs as that takes."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

from gtf_tune.definition import GtfDefinition, StudyDefinition, read_options
from gtf_tune.pipelines import OptionValue
from gtf_tune.sequence import Sequence as ImageSequence
from gtf_tune.store import studies
from gtf_tune.store.database import Database
from gtf_tune.store.studies import stored_definition
from gtf_tune.study.open_study import make_pipeline, runnable
from gtf_tune.study.outcome.confirm import looks_at
from gtf_tune.study.outcome.judge import NOT_BETTER, TOO_LITTLE, Findings, judge
from gtf_tune.study.outcome.recommendation import recommend, require_trial
from gtf_tune.study.outcome.verdict import ADOPT, Candidate, Verdict
from gtf_tune.study.runs.run_source import RunSource
from gtf_tune.study.systems import Bench, MeasuredSystem, System, chosen_noise, measure_system
from gtf_tune.study.tune.start import TuneRequest

MOST_RUNS = 12
"""Noisy runs of each configuration that a check takes at most; it looks at them as a confirmation does."""

CheckOutcome = Literal["holds", "does not hold", "no difference"]


@dataclass(frozen=True, eq=False)
class OptionCheck:
    """Options beside nominal on a sequence, after as many noisy runs as it took.

    ``nominal`` and ``checked`` are what the two gave, ``verdict`` is that of a confirmation at the level of one look.
    """

    nominal: MeasuredSystem
    checked: MeasuredSystem
    verdict: Verdict
    noisy_runs: int
    sigma: float

    @property
    def candidate(self) -> Candidate:
        """How the options compare with nominal."""
        return self.verdict.candidates[0]

    @property
    def outcome(self) -> CheckOutcome:
        """Whether the options hold: better than nominal, worse or faulty, or neither."""
        if self.verdict.word == ADOPT:
            return "holds"
        return "no difference" if set(self.candidate.reasons) <= {NOT_BETTER, TOO_LITTLE} else "does not hold"

    @property
    def text(self) -> str:
        """The outcome in sentences."""
        after = f"after {self.noisy_runs} noisy runs of each"
        change = f"GTF ATE {self.candidate.improvement.change} ({self.candidate.improvement.bounds})"
        if self.outcome == "holds":
            return f"The options hold here, {after}: {change} against nominal."
        if self.outcome == "no difference":
            return f"No difference from nominal worth a change shows {after}: {change}."
        return (
            f"The options do not hold here, {after}: {'; '.join(self.candidate.reasons)}. Use nominal, or tune again."
        )

    def as_json(self) -> dict[str, Any]:
        """Return the numbers by name."""
        return {
            "outcome": self.outcome,
            "noisy_runs": self.noisy_runs,
            "noise_sigma": self.sigma,
            "text": self.text,
        } | {
            "nominal_gtf_ate": self.nominal.score.value,
            "gtf_ate": self.checked.score.value,
            "candidate": self.candidate.as_json(),
        }


def check_options(
    nominal: System, checked: System, sequence: ImageSequence, gtf: GtfDefinition, seed: int, source: RunSource
) -> OptionCheck:
    """Compare options with nominal under the same noise, and stop at the first look that decides.

    Raises
    ------
    Interrupted
        Someone asked to stop; finished runs are stored.
    """
    bench = Bench(gtf, chosen_noise(nominal, sequence, gtf, seed, source), seed, source)
    for look in looks_at(MOST_RUNS):
        both = [
            measure_system(one, number, sequence, bench, look.noisy_runs)
            for number, one in enumerate((nominal, checked))
        ]
        verdict = judge(Findings(both[0].scores, (both[1].scores,)), gtf, look.significance)
        found = OptionCheck(both[0], both[1], verdict, look.noisy_runs, bench.sigma)
        if found.outcome != "no difference":
            break
    return found


@dataclass(frozen=True)
class Adopted:
    """What a study says to use: its nominal system, the one to use instead, and how it scored both.

    ``searched`` are the options of the trial to use. The noise of ``gtf`` is what the study measured where it was open.
    """

    nominal: System
    adopted: System
    searched: dict[str, OptionValue]
    gtf: GtfDefinition
    definition: StudyDefinition


def adopted_by(database: Database, name: str) -> Adopted:
    """Return what the study of that name says to use.

    Raises
    ------
    StorageError
        There is no such study, or it has no trial to use.
    DefinitionError
        Its pipeline is not to be had here.
    """
    record = studies.get(database, name)
    definition = stored_definition(record)
    pipeline = runnable(make_pipeline(definition), name)
    trial = require_trial(database, record, recommend(database, record))
    usual = {**definition.pipeline.options, **definition.pipeline.nominal}
    sigma = next(iter(record.resolved.get("noise_sigma", {}).values()), definition.gtf.noise_sigma)
    searched = dict(trial.options or {})
    nominal = System("nominal", pipeline, pipeline.options.check(usual))
    return Adopted(
        nominal,
        replace(nominal, name=name, options=pipeline.options.check({**usual, **searched})),
        searched,
        definition.gtf.model_copy(update={"noise_sigma": sigma}),
        definition,
    )


def systems_like(database: Database, name: str, options: Path | None) -> tuple[System, System, GtfDefinition]:
    """Return a study's nominal system, the one to check, and the score: its adopted options, or those of a file."""
    found = adopted_by(database, name)
    if options is None:
        return found.nominal, found.adopted, found.gtf
    pipeline = found.nominal.pipeline
    given = pipeline.options.check({**found.nominal.options, **read_options(options)})
    return found.nominal, System(str(options), pipeline, given), found.gtf


def tuned_like(database: Database, name: str, request: TuneRequest) -> TuneRequest:
    """Return a request that tries first what a study says to use, on its pipeline and in its space as well.

    Parts of the request that are given by hand stay as they are.
    """
    found = adopted_by(database, name)
    stored = found.definition.model_dump(mode="json", include={"pipeline", "space"})
    merged = {part: {**stored[part], **request.sections.get(part, {})} for part in ("pipeline", "space")}
    return replace(request, sections={**request.sections, **merged}, start=found.searched)
