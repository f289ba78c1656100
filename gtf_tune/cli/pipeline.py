"""List pipelines and their tunable options."""

from typing import Annotated

import typer

from gtf_tune.cli.parameters import Json, Settings
from gtf_tune.cli.terminal.console import say, write_json, write_line, write_table
from gtf_tune.cli.terminal.grouping import GroupedCommands
from gtf_tune.cli.values import parse_pairs

app = typer.Typer(cls=GroupedCommands, help="List pipelines and their tunable options.", no_args_is_help=True)


@app.command("list")
def list_pipelines(json: Json = False) -> None:
    """List the pipelines that can be tuned here.

    Example: gtf-tune pipeline list
    """
    from gtf_tune.errors import GtfTuneError
    from gtf_tune.pipelines import create_pipeline, pipeline_names

    rows = []
    for name in pipeline_names():
        try:
            pipeline = create_pipeline(name)
        except GtfTuneError as error:
            rows.append((name, "", str(error)))
            continue
        rows.append((name, pipeline.version, f"{len(pipeline.options.specs)} options"))
    if json:
        write_json([{"name": name, "version": version, "detail": detail} for name, version, detail in rows])
        return
    write_table(["pipeline", "version", "detail"], rows)
    say("Next: gtf-tune pipeline options glomap --grep reproj")


@app.command("options")
def options(
    name: Annotated[str, typer.Argument(metavar="PIPELINE", help="Name of the pipeline.")],
    grep: Annotated[str, typer.Option("--grep", help="Only options whose name or meaning contains TEXT.")] = "",
    setting: Settings = None,
    json: Json = False,
) -> None:
    """Print every tunable option of a pipeline: name, type, default, meaning.

    Example: gtf-tune pipeline options glomap --grep reproj
    """
    from gtf_tune.pipelines import create_pipeline, option_text

    specs = [
        spec
        for spec in create_pipeline(name, parse_pairs(setting, "--setting")).options.specs.values()
        if grep.lower() in spec.name.lower() or grep.lower() in spec.documentation.lower()
    ]
    if json:
        write_json(
            [
                {
                    "name": spec.name,
                    "type": spec.kind,
                    "default": spec.default,
                    "choices": list(spec.choices),
                    "documentation": spec.documentation,
                }
                for spec in specs
            ]
        )
        return
    for spec in specs:
        allowed = f" ({', '.join(spec.choices)})" if spec.choices else ""
        write_line(f"{spec.name} = {option_text(spec.default)}  [{spec.kind}]{allowed}")
        if spec.documentation:
            write_line(f"    {' '.join(spec.documentation.split())}")
    say(f"{len(specs)} options of {name}" + (f" with '{grep}'" if grep else ""))
