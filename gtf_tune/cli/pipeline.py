"""List pipelines and their tunable options."""

from collections.abc import Mapping
from typing import Annotated, Any

import typer

from gtf_tune.cli.parameters import Json, Settings
from gtf_tune.cli.terminal.console import say, write_json, write_line, write_table
from gtf_tune.cli.values import parse_pairs


def list_pipelines(json: Json = False) -> None:
    """List the pipelines that can be tuned here.

    The presets of `command` follow, each with how it was tried.

    Example: gtf-tune pipeline list
    """
    from gtf_tune.errors import GtfTuneError
    from gtf_tune.pipelines import create_pipeline, pipeline_names
    from gtf_tune.pipelines.command import how_tried, preset_names

    rows = []
    for name in pipeline_names():
        try:
            pipeline = create_pipeline(name)
        except GtfTuneError as error:
            rows.append((name, "", str(error)))
            continue
        rows.append((name, pipeline.version, f"{len(pipeline.options.specs)} options"))
    rows += [(f"command, preset={name}", "", how_tried(name)) for name in preset_names()]
    if json:
        write_json([{"name": name, "version": version, "detail": detail} for name, version, detail in rows])
        return
    write_table(["pipeline", "version", "detail"], rows)
    say("Next: gtf-tune pipeline options glomap --grep reproj")


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
    from gtf_tune.pipelines.preset_spaces import searched_options

    searched = searched_options(name)
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
                    "tier": searched[spec.name].tier if spec.name in searched else None,
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
        if spec.name in searched:
            found = searched[spec.name]
            write_line(f"    recommended to search: {_axis_text(found.axis)} (tier {found.tier})")
    say(f"{len(specs)} options of {name}" + (f" with '{grep}'" if grep else ""))


def presets(
    name: Annotated[str, typer.Argument(metavar="PIPELINE", help="Name of the pipeline.")] = "glomap",
    json: Json = False,
) -> None:
    """Print the presets of a pipeline: what each searches when nobody says, with the reason for each range.

    Example: gtf-tune pipeline presets glomap
    """
    from dataclasses import asdict

    from gtf_tune.pipelines.preset_spaces import preset_space

    preset = preset_space(name)
    if json:
        write_json(asdict(preset))
        return
    for found in preset.presets:
        write_line(f"--preset {found.name}: options of tier 1 to {found.tier}; adopted from {found.margin:.0%} on.")
        write_line(f"    {found.reason}")
    write_line("")
    for option in preset.options:
        unit = f" [{option.unit}]" if option.unit else ""
        only = ", only where the intrinsics are unknown" if option.unknown_intrinsics else ""
        write_line(f"{option.name}{unit}: {_axis_text(option.axis)}  (tier {option.tier}{only})")
        write_line(f"    {option.reason} Source: {option.source}.")
    write_line("")
    write_line("tried first: " + "; ".join(map(_options_text, preset.first)) if preset.first else "")
    for baseline in preset.baselines:
        write_line(f"also compared: {baseline.name}, {_options_text(baseline.options)}")
    say("tier 1 is always searched (only mapping is repeated); 2 repeats verification, 3 everything")


def _axis_text(axis: Mapping[str, Any]) -> str:
    from gtf_tune.pipelines import option_text

    if "values" in axis:
        return ", ".join(option_text(value) for value in axis["values"])
    scale = ", in logarithms" if axis.get("log") else ""
    return f"{option_text(axis['low'])} to {option_text(axis['high'])}{scale}"


def _options_text(options: Mapping[str, Any]) -> str:
    from gtf_tune.pipelines import option_text

    return ", ".join(f"{name.rpartition('.')[2]} = {option_text(value)}" for name, value in options.items())
