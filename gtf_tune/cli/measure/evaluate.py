"""Score one configuration, without a study."""

import math
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.measure.runs import (
    Aggregate,
    CleanRuns,
    Images,
    NoiseSigma,
    Options,
    Pipeline,
    Seed,
    score_definition,
)
from gtf_tune.cli.parameters import CacheDir, Frames, Jobs, Json, Keep, NoCache, Nominal, Settings
from gtf_tune.cli.sequence_flags import (
    CameraFlag,
    CameraGrouping,
    Cameras,
    Exclude,
    Recursive,
    load_as_asked,
    parse_selection,
)
from gtf_tune.cli.study.true_errors import Side
from gtf_tune.cli.terminal.console import number, say, write_json, write_pairs

if TYPE_CHECKING:
    from gtf_tune.display import ScoreUnit
    from gtf_tune.study.evaluate import Evaluation


def evaluate(
    sequence: Images,
    pipeline: Pipeline = "glomap",
    option: Options = None,
    nominal: Nominal = None,
    setting: Settings = None,
    frames: Frames = None,
    exclude: Exclude = None,
    recursive: Recursive = False,
    camera: CameraFlag = None,
    cameras: Cameras = CameraGrouping.auto,
    clean_runs: CleanRuns = 2,
    noisy_runs: Annotated[int, typer.Option("--noisy-runs", "-K", min=1, max=1000, help="k_delta.")] = 6,
    noise_sigma: NoiseSigma = "auto",
    aggregate: Aggregate = "median",
    side: Side = None,
    seed: Seed = 0,
    jobs: Jobs = None,
    cache_dir: CacheDir = None,
    no_cache: NoCache = False,
    storage: Annotated[
        str | None, typer.Option("--storage", help="Keep the runs here, and reuse those that are there already.")
    ] = None,
    keep: Keep = None,
    json: Json = False,
) -> None:
    """Print the GTF ATE of one configuration on one sequence; nothing is stored unless a storage is given.

    Exits with 1 where not a single run worked; 'gtf-tune pipeline try' shows one run with all its files.

    Example: gtf-tune evaluate images/ -o mapper.max_normalized_reproj_error=1e-3
    """
    from gtf_tune.cli.parameters import create_storage, default_jobs, make_executor
    from gtf_tune.cli.values import parse_options, parse_pairs
    from gtf_tune.definition import SideMetricDefinition
    from gtf_tune.definition.loading import section_from_dict
    from gtf_tune.display import sequence_unit
    from gtf_tune.pipelines import create_pipeline, with_focal_prior
    from gtf_tune.sequence import FEWEST_FRAMES, say_notes
    from gtf_tune.study.evaluate import Configuration, evaluate_configuration

    gtf = score_definition("evaluate", clean_runs, noisy_runs, noise_sigma, aggregate)
    chosen = create_pipeline(pipeline, parse_pairs(setting, "--setting"))
    given = parse_options(nominal, "--nominal") | parse_pairs(option, "--option")
    measured = section_from_dict(SideMetricDefinition, parse_pairs(side, "--side"), source="--side")
    wanted = Configuration(chosen, chosen.options.check(given), gtf, seed, side_metric=measured)
    selection = parse_selection(frames, exclude, recursive, cameras)
    loaded = load_as_asked(sequence, selection, camera, fewest=FEWEST_FRAMES)
    say_notes(with_focal_prior(loaded, chosen), say)
    database = create_storage(storage) if storage else None
    with make_executor(jobs or default_jobs(), cache_dir, no_cache=no_cache, keep=keep) as executor:
        found = evaluate_configuration(wanted, loaded, executor, say, database)
    if json:
        write_json(found.as_dict())
    else:
        _write(found, sequence_unit(gtf))
    if not found.any_run_worked:
        raise typer.Exit(1)


def _write(found: "Evaluation", unit: "ScoreUnit") -> None:
    score = found.score.score
    pairs = {unit.name: f"none: {found.score.message}"}
    if score is not None and found.score.feasible:
        low, high = score.confidence_interval
        known = math.isfinite(low) and math.isfinite(high)
        interval = f"95 % interval {unit.text(low)} to {unit.text(high)}" if known else "too few runs for an interval"
        pairs[unit.name] = f"{unit.text(score.value)} {unit.symbol} ({interval})"
        pairs["collapsed"] = f"{int(score.collapsed.sum())} of {score.collapsed.size} noisy runs"
    pairs["coverage"] = f"{found.score.coverage:.0%} of the frames (least of all runs)"
    if not math.isnan(found.side_metric):
        side = found.side_definition
        words = "degrees" if side.unit == "deg" else "in the unit of the ground truth"
        pairs[f"true {side.words}"] = f"{number(found.side_metric)} {words}"
    write_pairs(pairs)
