"""Define a report: which panels, in which order, under which titles."""

from importlib.resources import files
from pathlib import Path
from typing import Any, Literal, get_args

from pydantic import Field, ValidationError, model_validator

from gtf_tune.definition import read_toml
from gtf_tune.definition.base import Section
from gtf_tune.errors import DefinitionError

PanelKind = Literal[
    "verdict",
    "options",
    "agreement",
    "trajectories",
    "matrices",
    "frames",
    "search",
    "trials",
    "coverage",
    "failures",
    "costs",
    "timeline",
    "reproducibility",
]


class PanelDefinition(Section):
    """Name one panel and its title; ``text`` is a sentence under the title."""

    kind: PanelKind
    title: str
    text: str = ""


class ReportDefinition(Section):
    """Define a report.

    ``trajectory_points`` is how many frames of a trajectory are drawn at most, ``log_lines`` how many lines of the log
    of a failed run are shown, ``trial_rows`` how many trials are listed before the rest is folded away.
    """

    title: str = "Tuning without ground truth"
    trajectory_points: int = Field(default=300, ge=10)
    log_lines: int = Field(default=15, ge=1)
    trial_rows: int = Field(default=15, ge=1)
    panels: tuple[PanelDefinition, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _check_once(self) -> "ReportDefinition":
        kinds = [panel.kind for panel in self.panels]
        twice = sorted({kind for kind in kinds if kinds.count(kind) > 1})
        if twice:
            raise ValueError(f"every panel may appear once, not twice: {', '.join(twice)}")
        return self


def default_report_definition() -> ReportDefinition:
    """Return the definition that ships with the package: every panel."""
    return load_report_definition(Path(str(files("gtf_tune.report") / "report.toml")))


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
        faults = "; ".join(_sentence(one) for one in error.errors())
        raise DefinitionError(f"{path}: {faults}. Panels are {', '.join(get_args(PanelKind))}") from error


def _sentence(error: Any) -> str:
    where = ".".join(str(part) for part in error["loc"])
    message = error["msg"].removeprefix("Value error, ")
    return f"'{where}': {message}" if where else message
