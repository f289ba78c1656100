"""Show errors against ground truth beside the scores of trials."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.terminal.console import number

if TYPE_CHECKING:
    from gtf_tune.definition import SideMetricDefinition

Side = Annotated[
    list[str] | None,
    typer.Option(
        "--side",
        metavar="KEY=VALUE",
        help="Error against ground truth, as a key of [side_metric], such as metric=rpe_translation or alignment=se3.",
    ),
]


@dataclass(frozen=True)
class TrueErrors:
    """The side metric of trials by their numbers and the names of sequences, and which metric it is."""

    side: "SideMetricDefinition"
    by_trial: Mapping[int, Mapping[str, float | None]]

    @cached_property
    def sequences(self) -> list[str]:
        """Return the names of the sequences that have ground truth."""
        return list(dict.fromkeys(name for found in self.by_trial.values() for name in found))

    @property
    def columns(self) -> list[str]:
        """Return the titles of the columns of a table; none without ground truth."""
        unit = " [deg]" if self.side.unit == "deg" else ""
        title = f">true {self.side.words}{unit}"
        names = self.sequences
        return [title] if len(names) == 1 else [f"{title}, {name}" for name in names]

    def cells(self, trial_number: int) -> list[str]:
        """Return the errors of a trial, one for each column."""
        return [number(self.value(trial_number, name)) for name in self.sequences]

    def value(self, trial_number: int, sequence: str) -> float | None:
        """Return the error of a trial on a sequence, ``None`` where it is not known."""
        return self.by_trial.get(trial_number, {}).get(sequence)

    def as_json(self, trial_number: int) -> dict[str, Any]:
        """Return the error of a trial under its name (of a single sequence), and those of all sequences."""
        values = {name: self.value(trial_number, name) for name in self.sequences}
        single = next(iter(values.values())) if len(values) == 1 else None
        return {self.side.key: single, "ground_truth": values}
