"""Put studies side by side: what each picked, and what ground truth says of nominal, the pick and the best trial."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from statistics import fmean
from typing import Any

from gtf_tune.display import value_text
from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines import OptionValue
from gtf_tune.store import ground_truth_errors, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.store.studies import Study, stored_definition
from gtf_tune.store.trials import Trial
from gtf_tune.study.outcome.recommendation import recommend

BY = ("noise_sigma", "noisy_runs", "option", "sequence")
"""What rows can be sorted by, and name in a column of their own."""


@dataclass(frozen=True)
class ComparedStudy:
    """A study on one of its sequences.

    Attributes
    ----------
    by
        The value that rows are sorted by; empty where none was asked for.
    pick
        Options of the pick that differ from nominal: those of the feasible trial with the lowest score.
    decision
        Of the one who decides (see `Recommendation`); it may keep nominal.
    score_change
        Change of the score from nominal to the pick: -0.2 is a fifth smaller; ``None`` where nominal has none.
    true_nominal, true_pick, true_best
        Error against ground truth of nominal, of the pick, and the smallest of any feasible trial; ``None`` without
        ground truth.
    """

    study: str
    sequence: str
    by: str
    pick: Mapping[str, OptionValue]
    decision: str
    score_change: float | None
    true_nominal: float | None
    true_pick: float | None
    true_best: float | None

    @property
    def pick_text(self) -> str:
        """The options of the pick in words."""
        words = (f"{name.rpartition('.')[2]} = {value_text(value)}" for name, value in self.pick.items())
        return ", ".join(words) or "nominal"

    @property
    def true_change(self) -> float | None:
        """Change of the error against ground truth from nominal to the pick."""
        return _change(self.true_nominal, self.true_pick)

    @property
    def best_change(self) -> float | None:
        """Change of the error against ground truth from nominal to the best trial."""
        return _change(self.true_nominal, self.true_best)

    def as_json(self) -> dict[str, Any]:
        """Return the row for ``--json``."""
        return {**asdict(self), "true_change": self.true_change, "best_change": self.best_change}


@dataclass(frozen=True)
class Comparison:
    """Rows of studies, and what they say together."""

    rows: tuple[ComparedStudy, ...]

    @property
    def judged(self) -> tuple[ComparedStudy, ...]:
        """Rows with ground truth of nominal and of the pick."""
        return tuple(row for row in self.rows if row.true_change is not None)

    @property
    def improved(self) -> int:
        """Number of rows whose pick has a smaller error against ground truth than nominal."""
        return sum(row.true_change < 0 for row in self.judged if row.true_change is not None)

    @property
    def mean_change(self) -> float:
        """Mean change of the error against ground truth from nominal to the pick; NaN without ground truth."""
        return fmean(row.true_change for row in self.judged if row.true_change is not None) if self.judged else math.nan

    @property
    def mean_best_change(self) -> float:
        """Mean change from nominal to the best trial that ground truth would have found."""
        return fmean(row.best_change for row in self.judged if row.best_change is not None) if self.judged else math.nan

    @property
    def sentence(self) -> str:
        """What the rows say together, by the paper's convention: means of changes relative to nominal."""
        if not self.judged:
            return "No study here has ground truth of nominal and of its pick."
        return (
            f"The pick has a smaller error against ground truth than nominal in {self.improved} of "
            f"{len(self.judged)}; mean change {100 * self.mean_change:+.1f} %, of "
            f"{100 * self.mean_best_change:+.1f} % that ground truth would have found."
        )


def compare_studies(database: Database, names: Iterable[str], by: str = "") -> Comparison:
    """Return what studies picked, a row for each study and sequence that the search saw.

    Parameters
    ----------
    database, names
        Where the studies are, and which; they need not be finished.
    by
        One of `BY`; rows are sorted by it and name its value.

    Raises
    ------
    StorageError
        There is no such study.
    DefinitionError
        ``by`` is unknown.
    """
    if by and by not in BY:
        raise DefinitionError(f"studies are compared by one of {', '.join(BY)}, not '{by}'")
    rows = [row for name in dict.fromkeys(names) for row in _rows(database, studies.get(database, name), by)]
    return Comparison(tuple(sorted(rows, key=lambda row: _natural(row.by)) if by else rows))


def _rows(database: Database, study: Study, by: str) -> list[ComparedStudy]:
    known = [trial for trial in trials.of_study(database, study.id) if _counts(trial)]
    truth = ground_truth_errors.values(database, study.id)
    decision = recommend(database, study).decision
    searched = [sequence.name for sequence in stored_definition(study).searched_sequences]
    return [_row(study, name, by, decision, known, truth) for name in searched]


def _row(
    study: Study,
    sequence: str,
    by: str,
    decision: str,
    known: list[Trial],
    truth: Mapping[int, Mapping[str, float | None]],
) -> ComparedStudy:
    nominal = next((trial for trial in known if trial.number == 0), None)
    pick = min(known, key=lambda trial: (trial.value, trial.number), default=None)
    errors = {trial.number: truth.get(trial.number, {}).get(sequence) for trial in known}
    scores = (nominal.value if nominal else None, pick.value if pick else None)
    return ComparedStudy(
        study=study.name,
        sequence=sequence,
        by=_by(study, sequence, by),
        pick=_changed(nominal, pick),
        decision=decision,
        score_change=_change(*scores),
        true_nominal=errors.get(0),
        true_pick=errors.get(pick.number) if pick else None,
        true_best=min((error for error in errors.values() if error is not None), default=None),
    )


def _counts(trial: Trial) -> bool:
    return trial.state == "complete" and bool(trial.feasible) and trial.value is not None


def _changed(nominal: Trial | None, pick: Trial | None) -> dict[str, OptionValue]:
    usual = (nominal.options if nominal else None) or {}
    return {name: value for name, value in ((pick.options if pick else None) or {}).items() if usual.get(name) != value}


def _by(study: Study, sequence: str, by: str) -> str:
    definition = stored_definition(study)
    if by == "noise_sigma":
        sigma = study.resolved.get("noise_sigma", {}).get(sequence, definition.gtf.noise_sigma)
        return value_text(sigma)
    if by == "noisy_runs":
        return definition.gtf.noisy_runs_text
    return {"option": ", ".join(definition.space), "sequence": sequence}.get(by, "")


def _natural(text: str) -> tuple[int, float, str]:
    try:
        return (0, float(text), "")
    except ValueError:
        return (1, 0.0, text)


def _change(before: float | None, after: float | None) -> float | None:
    return after / before - 1 if before and after is not None else None
