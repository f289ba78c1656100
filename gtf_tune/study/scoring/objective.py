"""The value of a trial from its runs: the GTF score, with coverage as a constraint.

A run must register nearly as many frames as under nominal. Nothing here knows whether ground truth exists.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import version

import numpy as np

from gtf_tune.definition import GtfDefinition
from gtf_tune.errors import DefinitionError
from gtf_tune.gtf import GtfScore, GtfSettings, score_of_pairs
from gtf_tune.metrics import pairwise_matrix
from gtf_tune.pipelines.run import digest
from gtf_tune.store.studies import Study, stored_definition
from gtf_tune.study.runs.run_source import SequenceRuns
from gtf_tune.trajectory.alignment import MIN_MATCHED
from gtf_tune.version import __version__

SCORING_VERSION = 2
"""Version of the rules that turn runs into scores; to be raised whenever the same runs may score differently."""

KNOWN_RULES = (1, 2)
"""Versions of the rules by which studies can be scored: each keeps those that it began with."""

RESOLVED_KEY = "scoring_version"

LEAST_COMMON = 0.5
"""Part of the frames of the shorter of two runs that both must have registered."""

LOST_BELOW = 0.5
"""Share of the median coverage below which a nominal run has lost the sequence and sets no example."""

MOST_SPREAD = 0.1
"""Most that the floor gives way to the spread of nominal's coverage: else frames could be traded for error."""

LEAST_COUNTED = 0.75
"""Share of the frames of nominal's runs that these must have in common for them to be those that count."""

_MOST_DIGITS = 6
_SHOWN = 12


@dataclass(frozen=True)
class CoverageFloor:
    """Least coverage, a fraction of the frames, that clean and noisy runs must reach.

    ``frames`` are the ids of those frames by which runs are scored; None where all count.
    """

    clean: float
    noisy: float
    frames: frozenset[int] | None = None

    def at_least(self, other: "CoverageFloor") -> "CoverageFloor":
        """Return the higher of two floors, of each kind."""
        return replace(self, clean=max(self.clean, other.clean), noisy=max(self.noisy, other.noisy))


def least_floor(num_frames: int) -> CoverageFloor:
    """Return the floor of the nominal setting itself: the frames that an alignment needs."""
    return CoverageFloor(MIN_MATCHED / num_frames, MIN_MATCHED / num_frames)


def coverage_floor(
    clean: Sequence[float], noisy: Sequence[float], share: float, rules: int = SCORING_VERSION
) -> CoverageFloor:
    """Return the floor that the coverages of nominal's runs set, by the ``rules`` of a study.

    It is ``share`` of what nominal reaches: its lower quartile, less what the middle half of its runs differ by, at
    most `MOST_SPREAD`. Under the first rules it is ``share`` of the least coverage of each kind.

    Clean runs go by clean ones and noisy runs by noisy ones, so that nominal itself reaches the floor. Runs that failed
    or lost more than half of what others register set no example: one bad run must not open the door to settings that
    drop frames. Where no run of a kind worked, the other kind counts.
    """
    least = _least if rules == 1 else _lower_fence
    by_kind = [least(dependable) if (dependable := _dependable(kind)) else None for kind in (clean, noisy)]
    known = [one for one in by_kind if one is not None]
    if not known:
        return CoverageFloor(0.0, 0.0)
    of_clean, of_noisy = (share * (min(known) if one is None else one) for one in by_kind)
    return CoverageFloor(of_clean, of_noisy)


def below(share: float, wanted: float) -> tuple[str, str]:
    """Return a share of frames and the larger one that was wanted in per cent, with the digits that tell them apart."""
    both = [(f"{share:.{digits}%}", f"{wanted:.{digits}%}") for digits in range(_MOST_DIGITS + 1)]
    return next((one for one in both if one[0] != one[1]), both[-1])


def _dependable(coverages: Sequence[float]) -> list[float]:
    """Return the coverages of runs that did not lose the sequence; empty where none worked."""
    worked = [coverage for coverage in coverages if coverage > 0]
    return [coverage for coverage in worked if coverage >= LOST_BELOW * float(np.median(worked))]


def _least(coverages: Sequence[float]) -> float:
    return min(coverages)


def _lower_fence(coverages: Sequence[float]) -> float:
    low, high = np.quantile(coverages, [0.25, 0.75])
    return float(low - min(high - low, MOST_SPREAD))


def counted_frames(nominal: SequenceRuns) -> frozenset[int] | None:
    """Return the frames by which all configurations are scored: those that every dependable run of nominal registered.

    SLAM loses some frames of its start, others each time: what a configuration gains by losing them is no precision.
    None, for all frames, where nominal's runs have too few in common to stand for the sequence.
    """
    kinds = [(runs, _dependable([float(len(run)) for run in runs])) for runs in (nominal.clean, nominal.noisy)]
    sets = [
        frozenset(run.frame_ids.tolist()) for runs, least in kinds for run in runs if least and len(run) >= min(least)
    ]
    if not sets:
        return None
    common = frozenset.intersection(*sets)
    return common if len(common) >= LEAST_COUNTED * float(np.median([len(one) for one in sets])) else None


_UNBOUNDED_PENALTY = 1e6
_JUST_VIOLATED = 1e-9


@dataclass(frozen=True)
class SequenceScore:
    """Score of one sequence, or why there is none.

    ``violation`` is how far the worst run stays below the coverage floor (0 where none does), ``coverage`` the least
    coverage of any run, both as fractions of the sequence's frames. ``counted`` is the number of frames by which runs
    are scored; None where all count.
    """

    score: GtfScore | None
    coverage: float
    violation: float
    message: str = ""
    counted: int | None = None

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
    score = score_on(runs, floor.frames, settings_of(gtf))
    if score.pair_errors:
        reason = next(iter(score.pair_errors.values()))
        failing = len(score.pair_errors) / (len(runs.clean) * len(runs.noisy))
        return SequenceScore(score, coverage, failing, reason)
    least, reason = _least_common(score)
    if least < LEAST_COMMON:
        return SequenceScore(score, coverage, max(LEAST_COMMON - least, _JUST_VIOLATED), reason)
    return SequenceScore(
        score, coverage, min(missing, 0.0), counted=None if floor.frames is None else len(floor.frames)
    )


def score_on(runs: SequenceRuns, frames: frozenset[int] | None, settings: GtfSettings) -> GtfScore:
    """Return the score of runs by their poses at some frames, all where ``frames`` is None; coverages are of all."""
    at = runs if frames is None else runs.at(frames)
    pairs = pairwise_matrix(at.clean, at.noisy, settings.pair_metric)
    of_clean, of_noisy = ([len(run) for run in kind] for kind in (runs.clean, runs.noisy))
    return score_of_pairs(pairs, settings, of_clean, of_noisy, runs.num_frames)


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


_FORMER_NOISY_RUNS = 6
"""What the definition left unsaid when digests were first stored."""

_SCORED_BY = ("pipeline", "sequences", "gtf")


def made_by(study: Study) -> dict[str, str | int]:
    """Return what decides over the scores of a study's trials, beside their options: stored with each trial.

    ``definition`` is a digest of the sections that say how trials are scored; the others may change.
    """
    # Without defaults: definitions that are written by later versions say more of them.
    definition = stored_definition(study)
    sections = definition.model_dump(mode="json", include=set(_SCORED_BY), exclude_defaults=True)
    gtf = {**sections.pop("gtf", {}), "noisy_runs": definition.model_dump(mode="json")["gtf"]["noisy_runs"]}
    if gtf["noisy_runs"] == _FORMER_NOISY_RUNS:
        del gtf["noisy_runs"]
    sections |= {"gtf": gtf} if gtf else {}
    return {
        "gtf_tune": __version__,
        "optuna": version("optuna"),
        "scoring": rules_of(study),
        "definition": digest(sections)[:_SHOWN],
    }


def rules_of(study: Study) -> int:
    """Return the version of the rules by which a study is scored."""
    return int(study.resolved.get(RESOLVED_KEY, 1))


def check_rules(study: Study) -> None:
    """Raise `DefinitionError` unless this version has the rules by which the study is scored.

    Raises
    ------
    DefinitionError
        The study began with other rules.
    """
    began_with = rules_of(study)
    if began_with not in KNOWN_RULES:
        made_by = study.resolved["versions"].get("gtf_tune", "another version")
        raise DefinitionError(
            f"study '{study.name}' is scored by rules of version {began_with}, which gtf-tune {made_by} has, but this "
            f"one scores by version {SCORING_VERSION}; work on it with that gtf-tune, or create a new study"
        )
