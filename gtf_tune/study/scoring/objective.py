"""The value of a trial from its runs: the GTF score, with coverage as a constraint.

A run must register nearly as many frames as under nominal. Nothing here knows whether ground truth exists.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version

import numpy as np

from gtf_tune.definition import GtfDefinition
from gtf_tune.errors import DefinitionError
from gtf_tune.gtf import GtfScore, GtfSettings, gtf_score
from gtf_tune.pipelines.run import digest
from gtf_tune.store.studies import Study, stored_definition
from gtf_tune.study.runs.run_source import SequenceRuns
from gtf_tune.trajectory.alignment import MIN_MATCHED
from gtf_tune.version import __version__

LEAST_COMMON = 0.5
"""Part of the frames of the shorter of two runs that both must have registered."""

LOST_BELOW = 0.5
"""Share of the median coverage below which a nominal run has lost the sequence and sets no example."""

_MOST_DIGITS = 6
_SHOWN = 12


@dataclass(frozen=True)
class CoverageFloor:
    """Least coverage, a fraction of the frames, that clean and noisy runs must reach."""

    clean: float
    noisy: float

    def at_least(self, other: "CoverageFloor") -> "CoverageFloor":
        """Return the higher of two floors, of each kind."""
        return CoverageFloor(max(self.clean, other.clean), max(self.noisy, other.noisy))


def least_floor(num_frames: int) -> CoverageFloor:
    """Return the floor of the nominal setting itself: the frames that an alignment needs."""
    return CoverageFloor(MIN_MATCHED / num_frames, MIN_MATCHED / num_frames)


def coverage_floor(clean: Sequence[float], noisy: Sequence[float], share: float) -> CoverageFloor:
    """Return the floor that the coverages of nominal's runs set: ``share`` of the least of each kind.

    Clean runs go by clean ones and noisy runs by noisy ones, so that nominal itself reaches the floor. Runs that failed
    or lost more than half of what others register set no example: one bad run must not open the door to settings that
    drop frames. Where no run of a kind worked, the other kind counts.
    """
    by_kind = [_dependable(one) for one in (clean, noisy)]
    known = [one for one in by_kind if one is not None]
    if not known:
        return CoverageFloor(0.0, 0.0)
    return CoverageFloor(*(share * (min(known) if one is None else one) for one in by_kind))


def below(share: float, wanted: float) -> tuple[str, str]:
    """Return a share of frames and the larger one that was wanted in per cent, with the digits that tell them apart."""
    both = [(f"{share:.{digits}%}", f"{wanted:.{digits}%}") for digits in range(_MOST_DIGITS + 1)]
    return next((one for one in both if one[0] != one[1]), both[-1])


def _dependable(coverages: Sequence[float]) -> float | None:
    """Return the least coverage of runs that did not lose the sequence; None where none worked."""
    worked = [coverage for coverage in coverages if coverage > 0]
    if not worked:
        return None
    return min(one for one in worked if one >= LOST_BELOW * float(np.median(worked)))


_UNBOUNDED_PENALTY = 1e6
_JUST_VIOLATED = 1e-9


@dataclass(frozen=True)
class SequenceScore:
    """Score of one sequence, or why there is none.

    ``violation`` is how far the worst run stays below the coverage floor (0 where none does), ``coverage`` the least
    coverage of any run, both as fractions of the sequence's frames.
    """

    score: GtfScore | None
    coverage: float
    violation: float
    message: str = ""

    @property
    def feasible(self) -> bool:
        """Whether every run reaches the coverage floor and every pair could be aligned."""
        return self.score is not None and self.violation <= 0 and not self.message


@dataclass(frozen=True)
class TrialScore:
    """Value of a trial.

    ``value`` is what the sampler minimises: the GTF score, or a penalty above every possible score if the trial is
    infeasible. ``violation`` is the constraint (feasible where <= 0).
    """

    value: float
    violation: float
    coverage: float
    message: str
    by_sequence: Mapping[str, SequenceScore]

    @property
    def feasible(self) -> bool:
        """Whether the trial may be picked."""
        return self.violation <= 0

    @property
    def standard_error(self) -> float:
        """Standard error of ``value``; NaN where it is unknown.

        Over several sequences relative errors add in squares, since their noise is independent. The nominal scores that
        each is divided by count as exact.
        """
        relative = [score.standard_error / score.value for score in self._scores if score.value]
        if not relative or len(relative) < len(self.by_sequence):
            return math.nan
        return self.value * math.hypot(*relative) / len(relative)

    @property
    def confidence_interval(self) -> tuple[float, float]:
        """95 % confidence interval of ``value``; NaN where it is unknown."""
        bounds = [score.confidence_interval for score in self._scores]
        if len(bounds) == 1 and len(self.by_sequence) == 1:
            return bounds[0]
        if not bounds or len(bounds) < len(self.by_sequence) or not all(low > 0 for low, _ in bounds):
            return (math.nan, math.nan)
        half = math.hypot(*(math.log(high / low) / 2 for low, high in bounds)) / len(bounds)
        return (self.value * math.exp(-half), self.value * math.exp(half))

    @property
    def collapse_rate(self) -> float:
        """Share of noisy runs that collapsed, over all sequences; NaN where none was scored."""
        flags = [flag for score in self._scores for flag in score.collapsed.tolist()]
        return sum(flags) / len(flags) if flags else math.nan

    @property
    def _scores(self) -> list[GtfScore]:
        return [one.score for one in self.by_sequence.values() if one.score is not None]


def settings_of(gtf: GtfDefinition) -> GtfSettings:
    """Return the settings of the score that a definition asks for."""
    return GtfSettings(
        metric=gtf.metric,
        alignment=gtf.alignment,
        aggregate=gtf.aggregate,
        normalise=gtf.normalise,
        rpe_delta=gtf.rpe_delta,
        rpe_delta_unit=gtf.rpe_delta_unit,
        rpe_pairs=gtf.rpe_pairs,
    )


def score_sequence(runs: SequenceRuns, floor: CoverageFloor, gtf: GtfDefinition) -> SequenceScore:
    """Return the score of one sequence from its runs.

    Every run must reach ``floor``, and each noisy run must share half of its frames, or of those of the clean run if
    these are fewer, with every clean run: the error over a few common frames says nothing about the others.
    """
    found = [(share, floor.clean) for share in runs.clean_coverage]
    found += [(share, floor.noisy) for share in runs.noisy_coverage]
    coverage = min(share for share, _ in found)
    missing, worst, wanted = max((wanted - share, share, wanted) for share, wanted in found)
    if missing > 0 or runs.errors:
        shown, floor_shown = below(worst, wanted)
        message = runs.errors[0] if runs.errors else f"a run registered {shown} of the frames, less than {floor_shown}"
        return SequenceScore(None, coverage, max(missing, _JUST_VIOLATED), message)
    score = gtf_score(runs.clean, runs.noisy, settings_of(gtf), num_frames=runs.num_frames)
    if score.pair_errors:
        reason = next(iter(score.pair_errors.values()))
        failing = len(score.pair_errors) / (len(runs.clean) * len(runs.noisy))
        return SequenceScore(score, coverage, failing, reason)
    least, reason = _least_common(score)
    if least < LEAST_COMMON:
        return SequenceScore(score, coverage, max(LEAST_COMMON - least, _JUST_VIOLATED), reason)
    return SequenceScore(score, coverage, min(missing, 0.0))


def _least_common(score: GtfScore) -> tuple[float, str]:
    """Return the least share of frames that a pair of runs has in common, and the sentence that says so."""
    shares = score.common_shares
    if not shares.size:
        return 1.0, ""
    pair = np.unravel_index(int(np.argmin(shares)), shares.shape)
    reason = (
        f"a noisy run shares {score.matched[pair]} of its frames with a clean one, less than half of "
        f"{score.shorter[pair]}"
    )
    return float(shares[pair]), reason


def score_trial(
    by_sequence: Mapping[str, SequenceScore], nominal: Mapping[str, float] | None, gtf: GtfDefinition
) -> TrialScore:
    """Return the value of a trial from the scores of its sequences.

    One sequence: its score. Several: the geometric mean over sequences of score / nominal score, so that no sequence
    counts more for being larger or harder; ``nominal`` holds the scores of trial 0 (``None`` while it is being scored).
    """
    coverage = min(one.coverage for one in by_sequence.values())
    infeasible = {name: one for name, one in by_sequence.items() if not one.feasible}
    if infeasible:
        name, worst = max(infeasible.items(), key=lambda item: item[1].violation)
        message = worst.message if len(by_sequence) == 1 else f"{name}: {worst.message}"
        value = penalty(gtf, len(by_sequence)) * (2.0 - coverage)
        return TrialScore(value, max(worst.violation, _JUST_VIOLATED), coverage, message, by_sequence)
    violation = max(one.violation for one in by_sequence.values())
    value = _combine(by_sequence, nominal)
    return TrialScore(value, violation, coverage, "", by_sequence)


def penalty(gtf: GtfDefinition, num_sequences: int = 1) -> float:
    """Return a value that no feasible score exceeds.

    A Sim(3)-aligned ATE never exceeds the extent (scale 0 is allowed), an angle never 180 degrees; metrics in unknown
    units, and scores relative to nominal, have no bound of their own.
    """
    bound = settings_of(gtf).upper_bound
    return bound if math.isfinite(bound) and num_sequences == 1 else _UNBOUNDED_PENALTY


def _combine(by_sequence: Mapping[str, SequenceScore], nominal: Mapping[str, float] | None) -> float:
    values = {name: one.score.value for name, one in by_sequence.items() if one.score is not None}
    if len(values) == 1:
        return next(iter(values.values()))
    reference = nominal or values
    tiny = np.finfo(np.float64).tiny  # errors of exactly 0, as pipelines that do not react to noise have
    ratios = [max(values[name], tiny) / max(reference[name], tiny) for name in values]
    return float(np.exp(np.mean([math.log(ratio) for ratio in ratios])))


SCORING_VERSION = 1
"""Version of the rules that turn runs into scores; to be raised whenever the same runs may score differently."""

RESOLVED_KEY = "scoring_version"


_SCORED_BY = ("pipeline", "sequences", "gtf")


def made_by(study: Study) -> dict[str, str | int]:
    """Return what decides over the scores of a study's trials, beside their options: stored with each trial.

    ``definition`` is a digest of the sections that say how trials are scored; the others may change.
    """
    # Without defaults: definitions that are written by later versions say more of them.
    sections = stored_definition(study).model_dump(mode="json", include=set(_SCORED_BY), exclude_defaults=True)
    return {
        "gtf_tune": __version__,
        "optuna": version("optuna"),
        "scoring": SCORING_VERSION,
        "definition": digest(sections)[:_SHOWN],
    }


def check_rules(study: Study) -> None:
    """Raise `DefinitionError` unless the study is scored by the rules of this version.

    Raises
    ------
    DefinitionError
        The study began with other rules.
    """
    began_with = study.resolved.get(RESOLVED_KEY, 1)
    if began_with != SCORING_VERSION:
        made_by = study.resolved["versions"].get("gtf_tune", "another version")
        raise DefinitionError(
            f"study '{study.name}' is scored by rules of version {began_with}, which gtf-tune {made_by} has, but this "
            f"one scores by version {SCORING_VERSION}; work on it with that gtf-tune, or create a new study"
        )
