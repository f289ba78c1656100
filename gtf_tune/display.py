"""Format numbers and scores for people; what is not known becomes a dash."""

import math
from collections.abc import Iterable
from dataclasses import dataclass

from gtf_tune.definition import GtfDefinition, StudyDefinition
from gtf_tune.pipelines.options import option_text

UNKNOWN = "-"
_MINUTE_S = 60
_HOUR_S = 3600
_MIB = 2**20
_GIB = 2**30
_NAMES = {"ate": "GTF ATE", "rpe_translation": "GTF RPE", "rpe_rotation": "GTF RPE (rotation)"}
_PER_MILLE = 1000.0


def significant(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, such as 2.31, 0.0023, 1235 or 1.2e-05."""
    if not math.isfinite(value):
        return UNKNOWN
    whole = 10**digits - 0.5 <= abs(value) < 10**6
    return f"{value:.0f}" if whole else f"{value:.{digits}g}"


def interval(low: float, high: float) -> str:
    """Return the two ends of an interval, with three significant digits each."""
    if not (math.isfinite(low) and math.isfinite(high)):
        return UNKNOWN
    return f"{significant(low)} to {significant(high)}"


def percent(fraction: float) -> str:
    """Return a signed fraction in per cent with three significant digits, at most one decimal."""
    if not math.isfinite(fraction):
        return UNKNOWN
    return f"{100 * fraction:+.1f} %"


def share(fraction: float) -> str:
    """Return a fraction between 0 and 1 in per cent."""
    if not math.isfinite(fraction):
        return UNKNOWN
    return f"{100 * fraction:.3g} %"


def duration(seconds: float) -> str:
    """Return seconds as people say them: 0.42 s, 42 s, 3 min 20 s, 5 h 12 min."""
    if not math.isfinite(seconds):
        return UNKNOWN
    whole = round(seconds)
    if whole < _MINUTE_S:
        return f"{significant(seconds)} s" if seconds < 10 else f"{whole} s"
    if whole < _HOUR_S:
        return f"{whole // _MINUTE_S} min {whole % _MINUTE_S} s"
    return f"{whole // _HOUR_S} h {whole % _HOUR_S // _MINUTE_S} min"


def memory(count_bytes: float) -> str:
    """Return bytes in MB or GB (of 2**20 and 2**30 bytes)."""
    if not math.isfinite(count_bytes) or count_bytes <= 0:
        return UNKNOWN
    return f"{count_bytes / _GIB:.3g} GB" if count_bytes >= _GIB else f"{count_bytes / _MIB:.3g} MB"


def count(number: int, singular: str) -> str:
    """Return a number with its noun: 1 trial, 2 trials."""
    return f"{number} {singular if number == 1 else singular + 's'}"


def value_text(value: object) -> str:
    """Return the value of an option as a person would type it."""
    return option_text(value, digits=6)


def nominal_text(definition: StudyDefinition) -> str:
    """Return in words what the nominal setting is: the program's defaults, or what the user gave."""
    given = definition.pipeline.nominal
    if not given:
        return "the program's defaults"
    return f"yours: {', '.join(f'{name}={value_text(value)}' for name, value in given.items())}"


@dataclass(frozen=True)
class ScoreUnit:
    """The name of a score, the factor from stored to shown values, and the shown unit, short and in words."""

    name: str
    factor: float
    symbol: str
    words: str

    @property
    def label(self) -> str:
        """Return the title of an axis."""
        return f"{self.name} [{self.symbol}]"

    @property
    def short(self) -> str:
        """Return the shown unit for the narrow columns of a terminal."""
        return self.symbol.removesuffix(" of extent")

    def text(self, stored: float | None) -> str:
        """Format a stored value in the shown unit, with three significant digits; a dash where there is none."""
        return significant(self.shown(stored))

    def told(self, stored: float | None) -> str:
        """Format a stored value with its unit, in plain letters for the lines of a log; a dash where there is none."""
        text = self.text(stored)
        return text if text == "-" else f"{text} {'per mille' if self.factor == _PER_MILLE else self.symbol}"

    def shown(self, stored: float | None) -> float:
        """Return a stored value in the shown unit; NaN where there is none."""
        return float("nan") if stored is None else stored * self.factor


def short_names(names: Iterable[str]) -> list[str]:
    """Return the last part of each dotted path, or the whole path where the last part is not unique."""
    paths = list(names)
    last = [path.rpartition(".")[2] for path in paths]
    return [short if last.count(short) == 1 else path for short, path in zip(last, paths, strict=True)]


def sequence_unit(gtf: GtfDefinition) -> ScoreUnit:
    """Return the unit of the scores of one sequence."""
    name = _NAMES[gtf.metric]
    if gtf.metric == "rpe_rotation":
        return ScoreUnit(name, 1.0, "deg", "degrees")
    if gtf.normalise == "none":
        return ScoreUnit(name, 1.0, "unit of the trajectory", "units of the trajectory")
    return ScoreUnit(name, _PER_MILLE, "‰ of extent", "per mille of the trajectory's extent")


def definition_unit(definition: StudyDefinition) -> ScoreUnit:
    """Return the unit of the values of a study: that of its sequence, or the ratio to nominal for several."""
    if len(definition.searched_sequences) == 1:
        return sequence_unit(definition.gtf)
    name = _NAMES[definition.gtf.metric]
    return ScoreUnit(name, 1.0, "relative to nominal", "times nominal (geometric mean over the sequences)")
