"""Compare pipelines, programs or options on one sequence."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.measure.runs import Aggregate, CleanRuns, Images, NoiseSigma, Seed, obtaining_runs, score_definition
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
from gtf_tune.cli.terminal.console import duration, number, write_json, write_line, write_table

if TYPE_CHECKING:
    from gtf_tune.display import ScoreUnit
    from gtf_tune.study.systems import MeasuredSystem, SystemComparison


def compare(
    sequence: Images,
    systems: Annotated[
        list[str],
        typer.Argument(metavar="SYSTEM...", help="Pipelines, definitions (TOML) or options (JSON), two or more."),
    ],
    pipeline: Annotated[
        str, typer.Option("--pipeline", "-p", help="Pipeline that options in JSON are for.")
    ] = "glomap",
    setting: Settings = None,
    frames: Frames = None,
    exclude: Exclude = None,
    recursive: Recursive = False,
    camera: CameraFlag = None,
    cameras: Cameras = CameraGrouping.auto,
    clean_runs: CleanRuns = 2,
    noisy_runs: Annotated[int, typer.Option("--noisy-runs", "-K", min=4, max=1000, help="k_delta.")] = 8,
    noise_sigma: NoiseSigma = "auto",
    aggregate: Aggregate = "median",
    seed: Seed = 0,
    jobs: Jobs = None,
    cache_dir: CacheDir = None,
    json: Json = False,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Compare systems on one sequence under the same noise: score, interval, registered frames, time.

    Changes are those of each system against the first, noise instance by noise instance; a system that registers fewer
    frames is not comparable. "frames" are those of its worst run, "time" is that of a median run. Runs are stored:
    an interrupted comparison goes on, and another system costs its own runs only.

    Example: gtf-tune compare photos/ glomap tuned.json my_slam.toml
    """
    from gtf_tune.cli.values import parse_pairs
    from gtf_tune.display import sequence_unit
    from gtf_tune.sequence import FEWEST_FRAMES
    from gtf_tune.study.systems import compare_systems, read_system

    gtf = score_definition("compare", clean_runs, noisy_runs, noise_sigma, aggregate)
    chosen = [read_system(text, pipeline, parse_pairs(setting, "--setting")) for text in systems]
    loaded = load_as_asked(sequence, parse_selection(frames, exclude, recursive, cameras), camera, fewest=FEWEST_FRAMES)
    with obtaining_runs(storage, jobs, cache_dir) as source:
        found = compare_systems(chosen, loaded, gtf, seed, source)
    if json:
        write_json(found.as_json())
    else:
        _write(found, sequence_unit(gtf))


def _write(found: "SystemComparison", unit: "ScoreUnit") -> None:
    judged = bool(found.agreement.pairs)
    columns = ["system", f">{unit.name} [{unit.short}]", ">change", "95 % interval [%]", ">frames", ">time"]
    rows = [_row(found, index, unit, judged) for index in range(len(found.systems))]
    write_table([*columns, *([">true ATE"] if judged else [])], rows)
    for doubt in found.verdict.doubts or ():
        write_line(found.named(doubt))
    for index, system in enumerate(found.systems[1:], start=1):
        if remarks := found.remarks(index):
            write_line(f"{_short(system)}: {'; '.join(remarks)}")
    if judged:
        agreement = found.agreement
        write_line(
            f"the score orders {agreement.agreeing} of {agreement.pairs} pairs as ground truth does "
            f"(Kendall's tau {number(agreement.tau)})"
        )


def _row(found: "SystemComparison", index: int, unit: "ScoreUnit", judged: bool) -> tuple[str, ...]:
    system = found.systems[index]
    change, bounds = "", ""
    if index:
        effect = found.candidate(index).improvement
        comparable = found.is_comparable(index)
        change, bounds = (effect.change, effect.bounds.replace(" %", "")) if comparable else ("-", "not comparable")
    truth = (number(system.true_error),) if judged else ()
    time = duration(system.run_s)
    return _short(system), unit.text(system.score.value), change, bounds, f"{system.coverage:.0%}", time, *truth


def _short(system: "MeasuredSystem") -> str:
    return Path(system.name).name
