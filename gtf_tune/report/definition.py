"""Definition of a report: which panels, in which order, under which titles."""

from pathlib import Path
from typing import Any

from pydantic import Field, ValidationError, field_validator, model_validator

from gtf_tune.definition import read_toml
from gtf_tune.definition.base import Section
from gtf_tune.errors import DefinitionError
from gtf_tune.report.panels import registry
from gtf_tune.report.panels.base import Lengths


class PanelChoice(Section):
    """One panel of a report; ``title`` and ``text``, a sentence under the title, replace the panel's own."""

    kind: str
    title: str | None = None
    text: str | None = None

    @field_validator("kind")
    @classmethod
    def _check_kind(cls, kind: str) -> str:
        if kind not in registry.KINDS:
            raise ValueError(f"there is no panel '{kind}'")
        return kind


class ReportDefinition(Section):
    """What a report shows: by default every panel.

    ``trajectory_points`` is how many frames of a trajectory are drawn at most, ``log_lines`` how many lines of the log
    of a failed run are shown, ``trial_rows`` how many trials are listed before the rest is folded away.
    """

    title: str = "Tuning without ground truth"
    trajectory_points: int = Field(default=Lengths.trajectory_points, ge=10)
    log_lines: int = Field(default=Lengths.log_lines, ge=1)
    trial_rows: int = Field(default=Lengths.trial_rows, ge=1)
    panels: tuple[PanelChoice, ...] = Field(
        default_factory=lambda: tuple(PanelChoice(kind=kind) for kind in registry.KINDS), min_length=1
    )

    @property
    def lengths(self) -> Lengths:
        """How much the panels show at most."""
        return Lengths(self.trajectory_points, self.log_lines, self.trial_rows)

    @model_validator(mode="after")
    def _check_once(self) -> "ReportDefinition":
        kinds = [panel.kind for panel in self.panels]
        twice = sorted({kind for kind in kinds if kinds.count(kind) > 1})
        if twice:
            raise ValueError(f"every panel may appear once, not twice: {', '.join(twice)}")
        return self


def load_report_definition(path: Path) -> ReportDefinition:
    """Return the definition in a TOML file.

    Raises
    ------
    DefinitionError
        The file is missing or wrong; the message names every fault.
    """
    try:
        return ReportDefinition.model_validate(read_toml(path, "a report definition"))
    except ValidationError as error:
        faults = "; ".join(_sentence(fault) for fault in error.errors())
        raise DefinitionError(f"{path}: {faults}. Panels are {', '.join(registry.KINDS)}") from error


def _sentence(fault: Any) -> str:
    where = ".".join(str(part) for part in fault["loc"])
    message = fault["msg"].removeprefix("Value error, ")
    return f"'{where}': {message}" if where else str(message)
