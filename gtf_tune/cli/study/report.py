"""Write the report of a study, and follow one that others work on."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Storage, StudyName, open_storage
from gtf_tune.cli.terminal.console import say

if TYPE_CHECKING:
    from collections.abc import Mapping

    from gtf_tune.pipelines.colmap.clouds import SparseCloud
    from gtf_tune.report.build import Extras
    from gtf_tune.report.definition import ReportDefinition
    from gtf_tune.store.database import Database


class Format(StrEnum):
    """Name the forms of a report."""

    html = "html"
    png = "png"


def report(
    name: StudyName,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", help="The file, or a folder for png (default STUDY.html).")
    ] = None,
    format_: Annotated[Format, typer.Option("--format", help="One page, or every figure as an image.")] = Format.html,
    definition: Annotated[
        Path | None, typer.Option("--definition", help="Which panels, in which order; see dashboards/paper.toml.")
    ] = None,
    models: Annotated[
        Path | None,
        typer.Option("--models", metavar="DIR", help="Where 'gtf-tune tune -o' wrote (default IMAGES-tuned)."),
    ] = None,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Write everything about a study as one HTML page that works offline.

    Models that 'gtf-tune tune' made are shown in it.

    Example: gtf-tune study report photos -o report.html
    """
    from gtf_tune.report.build import build_sections, read_input, write_report
    from gtf_tune.report.images import require_kaleido, write_images

    database = open_storage(storage)
    panels = _panels(definition)
    if format_ is Format.png:
        require_kaleido()
        folder = output or Path(f"{name}-figures")
        written = write_images(folder, build_sections(read_input(database, name, panels), panels))
        say(f"wrote {len(written)} figures to {folder}")
        return
    path = output or Path(f"{name}.html")
    write_report(path, database, name, panels, extras(database, name, models))
    say(f"wrote {path}")


def extras(database: "Database", name: str, models: Path | None = None) -> "Extras":
    """Return what is shown besides the study: options to copy, and the models that lie in a folder, if any."""
    from gtf_tune.report.build import Extras
    from gtf_tune.study.tune.handover import model_folders

    folders = model_folders(models or _usual_folder(database, name), name)
    return Extras(snippets(database, name), _clouds(folders) if folders else {})


def _clouds(folders: "Mapping[str, Path]") -> "dict[str, SparseCloud]":
    from gtf_tune.errors import RunError
    from gtf_tune.pipelines.colmap.clouds import read_cloud

    try:
        return {title: read_cloud(folder) for title, folder in folders.items()}
    except RunError as error:
        say(f"the report shows no models: {error}")
        return {}


def _usual_folder(database: "Database", name: str) -> Path:
    """Return the folder into which `gtf-tune tune IMAGES` writes."""
    from gtf_tune.store import studies
    from gtf_tune.store.studies import stored_definition

    study = studies.get(database, name)
    images = Path(study.root) / stored_definition(study).sequences[0].path
    return images.with_name(f"{images.stem}-tuned")


def snippets(database: "Database", name: str) -> dict[str, str]:
    """Return the options to use in the forms that people paste; nothing where no trial is recommended."""
    from gtf_tune.store import studies
    from gtf_tune.store.studies import stored_definition
    from gtf_tune.study.outcome.export import common_camera, options_files
    from gtf_tune.study.outcome.recommendation import recommend

    study = studies.get(database, name)
    found = recommend(database, study)
    if found.trial is None:
        return {}
    definition = stored_definition(study)
    camera = common_camera(definition, studies.sequences(database, study.id))
    return options_files(definition, found.trial.options or {}, camera)


def _panels(path: Path | None) -> "ReportDefinition":
    from gtf_tune.report.definition import ReportDefinition, load_report_definition

    return ReportDefinition() if path is None else load_report_definition(path)
