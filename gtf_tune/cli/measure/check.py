"""Check whether options that were tuned elsewhere hold on a sequence."""

from pathlib import Path
from typing import Annotated

import typer

from gtf_tune.cli.measure.runs import CleanRuns, Images, NoiseSigma, Seed, obtaining_runs, score_definition
from gtf_tune.cli.parameters import DEFAULT_STORAGE, CacheDir, Frames, Jobs, Json, Settings, Storage
from gtf_tune.cli.sequence_flags import (
    CameraFlag,
    CameraGrouping,
    Cameras,
    Exclude,
    Recursive,
    load_as_asked,
    parse_selection,
)
from gtf_tune.cli.terminal.console import write_json, write_line, write_pairs

Like = Annotated[
    str | None, typer.Option("--like", metavar="STUDY", help="Study whose pipeline, noise and adopted options to take.")
]


def check(
    sequence: Images,
    options: Annotated[
        Path | None, typer.Option("--options", metavar="FILE.json", help="Options, as 'study export' writes them.")
    ] = None,
    like: Like = None,
    pipeline: Annotated[str, typer.Option("--pipeline", "-p", help="Pipeline, without --like.")] = "glomap",
    setting: Settings = None,
    frames: Frames = None,
    exclude: Exclude = None,
    recursive: Recursive = False,
    camera: CameraFlag = None,
    cameras: Cameras = CameraGrouping.auto,
    clean_runs: CleanRuns = 2,
    noise_sigma: NoiseSigma = "auto",
    seed: Seed = 0,
    jobs: Jobs = None,
    cache_dir: CacheDir = None,
    json: Json = False,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Say whether options that were tuned elsewhere hold on these images, with as few runs as that takes.

    Nominal and the options run under the same noise; after 4, 8 and 12 noisy runs of each the difference is looked at,
    and the first look that decides ends it. With --like the pipeline, its nominal options and the noise are those of a
    study, and so are the options unless others are given.

    Example: gtf-tune check photos/ --options tuned.json
    """
    from gtf_tune.cli.values import parse_pairs
    from gtf_tune.display import sequence_unit
    from gtf_tune.errors import DefinitionError
    from gtf_tune.sequence import FEWEST_FRAMES
    from gtf_tune.study.check_options import check_options, systems_like
    from gtf_tune.study.systems import read_system

    if options is None and like is None:
        raise DefinitionError("there are no options to check; give --options FILE.json or --like STUDY")
    loaded = load_as_asked(sequence, parse_selection(frames, exclude, recursive, cameras), camera, fewest=FEWEST_FRAMES)
    gtf = score_definition("check", clean_runs, 10, noise_sigma, "median")
    with obtaining_runs(storage, jobs, cache_dir) as source:
        if like is None:
            settings = parse_pairs(setting, "--setting")
            nominal, checked = read_system(pipeline, settings=settings), read_system(str(options), pipeline, settings)
        else:
            nominal, checked, gtf = systems_like(source.database, like, options)
        found = check_options(nominal, checked, loaded, gtf, seed, source)
    if json:
        write_json(found.as_json())
        return
    unit = sequence_unit(gtf)
    write_pairs(
        {
            "nominal": f"{unit.name} {unit.told(found.nominal.score.value)}",
            "these options": f"{unit.name} {unit.told(found.checked.score.value)}",
        }
    )
    write_line(found.text)
