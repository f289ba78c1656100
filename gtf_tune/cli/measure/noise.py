"""Find the noise that suits a sequence."""

import itertools
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.measure.runs import CleanRuns, Images, Options, Pipeline, Seed
from gtf_tune.cli.parameters import CacheDir, Frames, Jobs, Json, NoCache, Settings, default_jobs, make_executor
from gtf_tune.cli.sequence_flags import (
    CameraFlag,
    CameraGrouping,
    Cameras,
    Exclude,
    Recursive,
    load_as_asked,
    parse_selection,
)
from gtf_tune.cli.terminal.console import number, permille, say, write_json, write_line, write_table

if TYPE_CHECKING:
    from gtf_tune.study.ground_truth.linearity import TrueErrors
    from gtf_tune.study.noise.choice import NoiseLevel
    from gtf_tune.study.noise.ladder import NoiseScale

Sigmas = Annotated[
    str | None, typer.Option("--sigmas", help="Grey levels to try, weakest first (default 0.5,1,2,3,5,8).")
]


def noise(
    sequence: Images,
    pipeline: Pipeline = "glomap",
    option: Options = None,
    setting: Settings = None,
    frames: Frames = None,
    exclude: Exclude = None,
    recursive: Recursive = False,
    camera: CameraFlag = None,
    cameras: Cameras = CameraGrouping.auto,
    sigmas: Sigmas = None,
    clean_runs: CleanRuns = 2,
    runs: Annotated[int, typer.Option("--runs", "-K", min=2, max=1000, help="Noisy runs of each level.")] = 4,
    seed: Seed = 0,
    jobs: Jobs = None,
    cache_dir: CacheDir = None,
    no_cache: NoCache = False,
    figure: Annotated[Path | None, typer.Option("--figure", help="Write the curves to this HTML file.")] = None,
    json: Json = False,
) -> None:
    """Measure how the score grows with the noise, and recommend a noise in the linear range; nothing is stored.

    Level 0 is clean runs against clean runs with other seeds: what runs differ by without any noise. "signal" is the
    part of the score that noise causes, over the standard deviation from run to run. Where there is ground truth, the
    true error over the noise is shown as well, with the line through its first values.

    Example: gtf-tune noise images/ --runs 6 --figure noise.html
    """
    from gtf_tune.cli.values import parse_pairs
    from gtf_tune.definition import GtfDefinition, LimitsDefinition
    from gtf_tune.pipelines import create_pipeline, with_focal_prior
    from gtf_tune.sequence import FEWEST_FRAMES
    from gtf_tune.study.ground_truth.linearity import recorded, true_errors
    from gtf_tune.study.noise.choice import fresh_runs
    from gtf_tune.study.noise.ladder import LADDER, NoiseProbe
    from gtf_tune.study.runs.run_source import SequenceRuns, run_limits

    chosen = create_pipeline(pipeline, parse_pairs(setting, "--setting"))
    given = parse_pairs(option, "--option")
    ladder = _ladder(sigmas) if sigmas else LADDER
    gtf = GtfDefinition(clean_runs=clean_runs)
    probe = NoiseProbe(chosen, chosen.options.check(given), gtf, seed, runs, ladder)
    selection = parse_selection(frames, exclude, recursive, cameras)
    loaded = with_focal_prior(load_as_asked(sequence, selection, camera, fewest=FEWEST_FRAMES), chosen)
    seen: list[SequenceRuns] = []
    with make_executor(jobs or default_jobs(), cache_dir, no_cache=no_cache) as executor:
        obtain = recorded(fresh_runs(executor, run_limits(LimitsDefinition())), seen)
        found = probe.measure(loaded, obtain, _say_level)
    truth = true_errors(found, seen, loaded.ground_truth) if loaded.ground_truth else None
    if json:
        write_json({**_as_json(found), **({"true_errors": asdict(truth)} if truth else {})})
    else:
        _write(found, truth)
    if figure:  # last: what was measured is told also where the file cannot be written
        from gtf_tune.report.noise_page import write_noise_page

        write_noise_page(figure, found, loaded.name, pipeline, truth)
        say(f"wrote {figure}")


def _ladder(text: str) -> tuple[float, ...]:
    from gtf_tune.errors import DefinitionError

    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError as error:
        raise DefinitionError(f"--sigmas takes numbers with commas between them, not '{text}'") from error
    if any(one >= other for one, other in itertools.pairwise(values)) or not 0 < values[0] <= values[-1] <= 255:
        raise DefinitionError(f"--sigmas takes rising grey levels in (0, 255], not '{text}'")
    return values


def _say_level(level: "NoiseLevel") -> None:
    faults = f", {level.collapsed} collapsed" if level.collapsed else ""
    faults += f", {level.failed} failed" if level.failed else ""
    say(f"sigma {level.sigma:g}: {permille(level.score)} per mille of the extent{faults}")


def _write(found: "NoiseScale", truth: "TrueErrors | None") -> None:
    rows = [_row(found.floor, math.nan, math.nan, "floor")]
    for level, response, ratio, inside in zip(found.levels, found.responses, found.ratios, found.linear, strict=True):
        mark = "recommended" if level.sigma == found.recommended else "linear" if inside else ""
        rows.append(_row(level, response, ratio, mark))
    write_table([">sigma", ">score [‰]", ">spread", ">[‰]/grey", ">signal", ">collapsed", ">failed", ""], rows)
    for name, line, unit in (("score", found.score_line, "sigma"), ("score^2", found.square_line, "sigma^2")):
        write_line(f"{name} over {unit} in the linear range: R2 {number(line.r_squared)}")
    if truth is not None:
        ends = f"{number(truth.errors[0])} without noise, {number(truth.errors[-1])} at sigma {truth.sigmas[-1]:g}"
        write_line(f"true ATE: {ends}")
        write_line(f"true ATE over sigma, first values: R2 {number(truth.line.r_squared)}")
    write_line(f"recommended noise: sigma {found.recommended:g} grey levels")
    say(found.reason)


def _row(level: "NoiseLevel", response: float, ratio: float, mark: str) -> tuple[str, ...]:
    spread = f"{level.spread:.0%}" if math.isfinite(level.spread) else "-"
    faults = f"{level.collapsed}/{level.runs}", f"{level.failed}/{level.runs}"
    return f"{level.sigma:g}", permille(level.score), spread, permille(response), number(ratio), *faults, mark


def _as_json(found: "NoiseScale") -> dict[str, Any]:
    levels = [
        {**vars(level), "response": response, "signal_to_spread": ratio, "linear": inside}
        for level, response, ratio, inside in zip(
            found.levels, found.responses, found.ratios, found.linear, strict=True
        )
    ]
    return {
        "recommended": found.recommended,
        "reason": found.reason,
        "floor": vars(found.floor),
        "levels": levels,
        "score_against_sigma": vars(found.score_line),
        "squared": vars(found.square_line),
    }
