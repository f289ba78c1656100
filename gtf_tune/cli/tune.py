"""Tune a pipeline on images from the first look to a better reconstruction, in a number of minutes."""

import contextlib
import time
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gtf_tune.cli.parameters import (
    DEFAULT_STORAGE,
    CacheDir,
    Jobs,
    Settings,
    Storage,
    create_storage,
    default_jobs,
    hush_optuna,
    make_executor,
    storage_flag,
)
from gtf_tune.cli.sequence_flags import CameraGrouping, Cameras
from gtf_tune.cli.study.create import Pipeline, Range, parse_range
from gtf_tune.cli.study.notes import say_disk
from gtf_tune.cli.terminal.console import INTERRUPTED_EXIT_CODE, duration, say, write_line
from gtf_tune.cli.values import parse_pairs, split_pairs

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Mapping

    from gtf_tune.pipelines import OptionValue
    from gtf_tune.store.database import Database
    from gtf_tune.study.events import Callback, Event
    from gtf_tune.study.open_study import OpenStudy
    from gtf_tune.study.outcome.recommendation import Recommendation
    from gtf_tune.study.tune.budget import Plan
    from gtf_tune.study.tune.start import TuneRequest, Tuning
    from gtf_tune.trajectory import Trajectory

Source = Annotated[
    Path,
    typer.Argument(
        metavar="IMAGES|VIDEO|FILE.toml", help="Images in any known layout, a video, or a study definition."
    ),
]
VIDEOS = (".mp4", ".mov", ".avi", ".mkv", ".webm", ".m4v")
_LATE_S = 30.0
"""How much later than planned the last reconstruction may end before it is given up."""
FRAMES_HZ = 2.0
"""Frames a second that are taken from a video; 'gtf-tune sequence extract' takes others."""
Minutes = Annotated[float, typer.Option("--minutes", "-m", min=0.1, max=1e6, help="Wall time for everything.")]
Output = Annotated[Path | None, typer.Option("--output", "-o", help="Folder of the outcome (default SOURCE-tuned).")]
New = Annotated[bool, typer.Option("--new", help="Begin another study, even if one of the same images is under way.")]
Like = Annotated[
    str | None, typer.Option("--like", metavar="STUDY", help="Study whose adopted options are tried first.")
]
Preset = Annotated[
    str, typer.Option("--preset", metavar="NAME", help="What is searched; see 'gtf-tune pipeline presets'.")
]


def tune(
    source: Source,
    minutes: Minutes = 30.0,
    pipeline: Pipeline = None,
    setting: Settings = None,
    range_: Range = None,
    preset: Preset = "mapping",
    cameras: Cameras = CameraGrouping.auto,
    jobs: Jobs = None,
    output: Output = None,
    new: New = False,
    like: Like = None,
    cache_dir: CacheDir = None,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Find the options that give the most precise trajectory on these images, and reconstruct with them.

    Calling it again goes on where it stopped. Ctrl-C keeps everything that has finished.

    Example: gtf-tune tune photos/ --minutes 30
    """
    ends = time.monotonic() + 60 * minutes
    say(f"inspect: {source}")  # before imports and a new storage, which take seconds
    from gtf_tune.study.open_study import open_study
    from gtf_tune.study.outcome.recommendation import NOTHING_FEASIBLE
    from gtf_tune.study.runs.plan import kept_runs
    from gtf_tune.study.tune.budget import Reduction
    from gtf_tune.study.tune.handover import check_output, makes_models

    hush_optuna()
    given = source
    if source.suffix.lower() in VIDEOS:
        source = _frames_of(source)
        setting = [*(["pairing=sequential"] if makes_models(pipeline or "glomap") else []), *(setting or [])]
    with _resumable():
        database, sections = create_storage(storage), _sections(source, pipeline, setting, range_)
        sections |= _grouped(source, sections, cameras)
        request = _request(source, minutes, jobs or default_jobs(), preset, sections)
        if like is not None:
            from gtf_tune.study.check_options import tuned_like

            request = tuned_like(database, like, request)
        folder = output or _outcome_of(given)
        check_output(folder)
        tuning = _begin(database, request, (folder, ends), cache_dir, new=new)
        if tuning is None:
            return
        study = open_study(database, tuning.name)
        say_disk(cache_dir)
        found = _tune_through(study, tuning, request, cache_dir, ends)
        _hand_over(study, found, folder, ends)
        _report(database, tuning.name, folder)
        write_line("")
        for line in (*_verdict(found, study.space.nominal), found.text):
            write_line(line)
        if found.decision == NOTHING_FEASIBLE and tuning.plan.reduction != Reduction():
            write_line("The search used fewer or smaller images for want of time; give more minutes for all of them.")
        write_line(f"{folder}: models, scripts that make them, trajectory, report; README.txt says what is what")
        took = duration(60 * minutes - (ends - time.monotonic()))
        kept = kept_runs(database, study.record).text
        if kept:
            say(f"{kept}; the same command with more minutes goes on")
        say(f"it took {took}; see: gtf-tune study show {tuning.name}{storage_flag(database)}")


@contextlib.contextmanager
def _resumable() -> "Iterator[None]":
    """Say after a Ctrl-C that nothing else has heard of that the command goes on where it stopped."""
    try:
        yield
    except KeyboardInterrupt:
        say("stopped; the same command goes on")
        raise typer.Exit(INTERRUPTED_EXIT_CODE) from None


def _tune_through(
    study: "OpenStudy", tuning: "Tuning", request: "TuneRequest", cache_dir: Path | None, ends: float
) -> "Recommendation":
    """Search, shorten and confirm with one progress display, so that the rest ends in time; exit if stopped."""
    from gtf_tune.cli.terminal.tune_progress import TuneProgress
    from gtf_tune.display import definition_unit
    from gtf_tune.report.dashboard.sync import DashboardSync
    from gtf_tune.study.runs.run_source import Interrupted
    from gtf_tune.study.runs.stop import StopRequest, signals_to
    from gtf_tune.study.tune.pace import WRITE
    from gtf_tune.study.tune.phases import Means, pace_of, tune_through

    pace = pace_of(study, tuning.plan, request.jobs, ends - time.monotonic())
    stop, shown = StopRequest(), DashboardSync(study.database, study.definition.name, warn=say)
    progress = TuneProgress(pace, definition_unit(study.definition))
    callbacks: list[Callback] = [progress.on_event, shown.on_event, partial(_say_first_verdict, study, progress.say)]
    with signals_to(stop, progress.say), make_executor(request.jobs, cache_dir) as executor, progress:
        try:
            found = tune_through(study, Means(executor, stop, callbacks, progress.say, pace))
        except Interrupted:
            found = None
    if found is None or stop.level:
        say("stopped; the same command goes on")
        raise typer.Exit(INTERRUPTED_EXIT_CODE)
    pace.begin(WRITE)
    say(f"write: about {duration(pace.left_s)} left")
    shown.bring_up_to_date()
    return found


def _outcome_of(source: Path) -> Path:
    """Return the folder beside a source that gets the outcome by default."""
    named = source if source.name not in ("", "..") else source.resolve()
    return named.with_name(f"{named.stem}-tuned")


def _frames_of(video: Path) -> Path:
    """Return the folder of a video's frames, extracted now unless an earlier call has done so."""
    from gtf_tune.sequence import Extraction, extract_video

    folder = video.with_name(f"{video.stem}-frames")
    if not folder.exists():
        say(f"taking the sharpest frame of each half second of {video.name}, into {folder}")
        extract_video(video, folder, Extraction(rate_hz=FRAMES_HZ))
    return folder


def _sections(
    source: Path, pipeline: str | None, settings: list[str] | None, ranges: list[str] | None
) -> dict[str, Any]:
    """Return the parts of a study definition that the file and the flags give."""
    from gtf_tune.definition import read_toml

    sections: dict[str, Any] = dict(read_toml(source)) if source.suffix == ".toml" else {}
    given: dict[str, Any] = {"name": pipeline} if pipeline else {}
    if settings:
        given["settings"] = {**sections.get("pipeline", {}).get("settings", {}), **parse_pairs(settings, "--setting")}
    if given:
        sections["pipeline"] = {"name": "glomap", **sections.get("pipeline", {}), **given}
    axes = {name: parse_range(name, text) for name, text in split_pairs(ranges or [], "--range").items()}
    if axes:
        sections["space"] = {**sections.get("space", {}), **axes}
    return sections


def _grouped(source: Path, sections: dict[str, Any], cameras: CameraGrouping) -> dict[str, Any]:
    """Return the section of the sequences where their images are to be grouped by camera in another way."""
    from gtf_tune.definition.model import name_from

    if cameras is CameraGrouping.auto:
        return {}
    sequences = sections.get("sequences") or [{"name": name_from(source.stem), "path": source.name}]
    return {"sequences": [{**sequence, "cameras": cameras.value} for sequence in sequences]}


def _request(source: Path, minutes: float, jobs: int, preset: str, sections: dict[str, Any]) -> "TuneRequest":
    from gtf_tune.study.tune.start import TuneRequest, tier_of

    return TuneRequest(source, minutes, jobs, tier_of(preset, sections), sections)


def _begin(
    database: "Database", request: "TuneRequest", place: tuple[Path, float], cache_dir: Path | None, *, new: bool
) -> "Tuning | None":
    """Return the study of these images, begun now or before; None where the time buys no comparison, which is said.

    ``place`` is the folder of the outcome, and the end.
    """
    from gtf_tune.definition.model import LimitsDefinition
    from gtf_tune.errors import RunError
    from gtf_tune.study.runs.run_source import Interrupted, RunSource, run_limits
    from gtf_tune.study.runs.stop import StopRequest, signals_to, stopped_in_time
    from gtf_tune.study.tune.choice import TooLittleTime
    from gtf_tune.study.tune.estimate import Beginning
    from gtf_tune.study.tune.reconstruct import TooSlow
    from gtf_tune.study.tune.start import begin_tuning, known_tuning

    folder, ends = place
    known = None if new else known_tuning(database, request)
    if known is not None:
        say(f"going on with study '{known.name}'; --new begins another one")
        return known
    stop, minutes = StopRequest(), f"{round(request.minutes, 1):g} minutes"
    clock = StopRequest(stop)

    def left_s() -> float:
        return ends - time.monotonic()

    with signals_to(stop, say), make_executor(request.jobs, cache_dir) as executor, stopped_in_time(clock, left_s):
        source = RunSource(database, executor, run_limits(LimitsDefinition()), clock)
        try:
            tuning = begin_tuning(database, request, Beginning(source, folder, left_s, say))
        except (Interrupted, RunError) as error:
            if stop.level:
                say("stopped while timing; the runs that have ended are stored, and the same command goes on from them")
                raise typer.Exit(INTERRUPTED_EXIT_CODE) from None
            if not clock.level and not isinstance(error, TooSlow):
                raise
            raise RunError(
                f"{minutes} are over before the first run and the nominal reconstruction have ended; the same command "
                "with more minutes goes on from what is stored"
            ) from error
    if isinstance(tuning, TooLittleTime):
        write_line(
            f"Nothing was compared: {minutes} buy the nominal reconstruction only; to compare anything on these images "
            f"needs about {tuning.minutes} minutes, or {tuning.more_minutes} when the same command goes on from what "
            "is stored."
        )
        write_line(f"{folder}: the outcome with the nominal options; README.txt says what is what")
        say(f"it took {duration(60 * request.minutes - left_s())}")
        return None
    say(f"created study '{tuning.name}'")
    _say_plan(tuning.plan)
    return tuning


def _say_plan(plan: "Plan") -> None:
    from gtf_tune.display import count

    confirmation = "no time to confirm"
    if plan.confirmation_runs:
        confirmation = f"a confirmation with {plan.confirmation_runs} noisy runs"
    trials = f"{plan.trials} trials with {count(plan.noisy, 'noisy run')} each"
    say(f"plan: {trials}, {confirmation}, another reconstruction; about {duration(plan.seconds)} in all")


def _say_first_verdict(study: "OpenStudy", announce: "Callable[[str], None]", event: "Event") -> None:
    """Say what the first configurations found, as soon as all of them are tried."""
    from gtf_tune.study.events import TrialFinished
    from gtf_tune.study.outcome.recommendation import recommend

    first = len(study.definition.search.first)
    if first and isinstance(event, TrialFinished) and event.number == first:
        announce(f"first verdict: {recommend(study.database, study.record).text}")


def _verdict(found: "Recommendation", nominal: "Mapping[str, OptionValue]") -> tuple[str, ...]:
    """Return in one sentence which options to take instead of nominal, and what they gain; nothing to keep nominal."""
    from gtf_tune.pipelines.options import option_text
    from gtf_tune.study.outcome.recommendation import UNCONFIRMED
    from gtf_tune.study.outcome.verdict import ADOPT

    if found.decision not in (ADOPT, UNCONFIRMED) or found.trial is None:
        return ()
    options = {name: value for name, value in (found.trial.options or {}).items() if value != nominal.get(name)}
    named = ", ".join(f"{name} = {option_text(value, digits=4)}" for name, value in options.items())
    better = found.improvement
    less = f"the trajectory moves {100 * better.value:.0f} % less under noise"
    if better.low == better.low:
        less += f" (95 %: {100 * better.low:.0f} to {100 * better.high:.0f} %)"
    return (f"{'Adopt' if found.decision == ADOPT else 'Not confirmed yet:'} {named}: {less}.",)


def _hand_over(study: "OpenStudy", found: "Recommendation", folder: Path, ends: float) -> None:
    """Write the models and scripts of a COLMAP pipeline, or the options and trajectories of another."""
    from gtf_tune.study.tune.budget import AROUND_S
    from gtf_tune.study.tune.handover import hand_over, hand_over_trajectories, makes_models
    from gtf_tune.study.tune.reconstruct import Workshop
    from gtf_tune.study.tune.start import recommended, whole_sequence

    used = whole_sequence(study, "models")
    configurations = recommended(study, found, used)
    if not makes_models(study.definition.pipeline.name):
        hand_over_trajectories(folder, configurations, _clean_trajectories(study, found))
        return
    timeout_s = max(ends - time.monotonic(), 0.0) + _LATE_S
    workshop = Workshop(used, study.pipeline, say, timeout_s, study=study.definition.name)
    written = hand_over(folder, workshop, configurations, check_until=ends - AROUND_S)
    models = {"nominal": written.nominal.model, "adopted": written.adopted, "unconfirmed": written.unconfirmed}
    for name, model in models.items():
        if model is not None and (name == "nominal" or model is not written.nominal.model):
            say(f"{name}: {len(model.trajectory)} of {len(used)} images, {model.num_points} points")
    if written.label != configurations.label:
        write_line(written.label)
    moved = found.trial.value if found.trial and study.definition.gtf.normalise == "extent" else None
    limit = written.calibration_limit(moved) if moved is not None else ""
    if limit:
        write_line(limit)


def _clean_trajectories(study: "OpenStudy", found: "Recommendation") -> "dict[str, Trajectory]":
    """Return the trajectory of the first clean run of the nominal and of the adopted trial."""
    from gtf_tune.store import runs, trials
    from gtf_tune.store.runs import trajectories

    numbers = {"nominal": 0, "adopted": found.trial.number if found.trial else 0}
    keys = {}
    for name, number in numbers.items():
        uses = runs.of_trial(study.database, trials.get(study.database, study.record.id, number).id)
        keys[name] = next(use.run.key for use in uses if use.run.kind == "clean")
    poses = trajectories(study.database, list(set(keys.values())))
    return {name: poses[key] for name, key in keys.items()}


def _report(database: "Database", name: str, folder: Path) -> None:
    from gtf_tune.cli.study.report import extras
    from gtf_tune.report.build import write_report
    from gtf_tune.report.definition import ReportDefinition

    write_report(folder / "report.html", database, name, ReportDefinition(), extras(database, name, folder))
