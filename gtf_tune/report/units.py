"""Say in which unit scores are shown."""

from dataclasses import dataclass

from gtf_tune.definition import GtfDefinition, StudyDefinition
from gtf_tune.report.numbers import significant

_NAMES = {"ate": "GTF ATE", "rpe_translation": "GTF RPE", "rpe_rotation": "GTF RPE (rotation)"}
_PER_MILLE = 1000.0


@dataclass(frozen=True)
class ScoreUnit:
    """Hold the name of a score, the factor from stored to shown values, and the shown unit, short and in words."""

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
