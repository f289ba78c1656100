"""Measure the paper's figures, or go on with them, and write docs/paper.md from what there is."""

import argparse
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from experiments.ladder import NotMeasuredError, only_stored
from experiments.measure import Bench, finish_study, local_executor
from experiments.paper.figures import Linearity, linearity_of
from experiments.paper.page import Paper, write_page
from experiments.paper.plan import LADDER, LADDER_RUNS, PIPELINE, STANDINS, PaperStudy, full_studies, light_studies
from experiments.settings import read_outcome
from gtf_tune.definition import GtfDefinition, LimitsDefinition
from gtf_tune.pipelines import create_pipeline
from gtf_tune.sequence import load_sequence
from gtf_tune.sequence.render.room import render_room
from gtf_tune.store.database import create_database
from gtf_tune.study.noise.choice import stored_runs
from gtf_tune.study.noise.ladder import NoiseProbe
from gtf_tune.study.runs.run_source import Interrupted, RunSource, run_limits
from gtf_tune.study.runs.stop import StopRequest, signals_to
from gtf_tune.trajectory import Trajectory

FOLDER = Path("storage/data/paper")
_OFFICE = "office"
_BEFORE_LINEARITY = 2


def main() -> None:
    """Measure what is missing, write the page after each study, and stop on request."""
    given = _arguments()
    studies = full_studies(given.data, given.points) if given.data else light_studies(given.folder)
    if not studies:
        raise SystemExit(
            f"none of the paper's sequences lies below {given.data}; 'gtf-tune sequence layouts' says where"
        )
    given.folder.mkdir(parents=True, exist_ok=True)
    database, stop = create_database(str(given.folder / "paper.db")), StopRequest()
    bench = Bench(database, {name: given.folder / name for name in (() if given.data else STANDINS)}, stop)
    write_page(_read(bench, studies))
    if given.write_only:
        return
    with signals_to(stop, print):
        try:
            _measure(bench, studies)
        except Interrupted:
            print("stopped; the same command goes on")
    write_page(_read(bench, studies))


def _measure(bench: Bench, studies: Sequence[PaperStudy]) -> None:
    for name, folder in bench.folders.items():
        if not (folder / "groundtruth.txt").exists():
            _timed(f"render {name}", partial(render_room, folder, STANDINS[name], 1))
    for number, study in enumerate(studies):
        if bench.folders and number == _BEFORE_LINEARITY:
            _timed("linearity", partial(_linearity, bench))
        _timed(study.study, partial(finish_study, bench, study.study, study.data))
        write_page(_read(bench, studies))


def _read(bench: Bench, studies: Sequence[PaperStudy]) -> Paper:
    found = [read_outcome(bench.database, study, None) for study in studies]
    outcomes = [one for one in found if one is not None and one.works]
    return Paper(outcomes, studies, _read_linearity(bench), is_light=bool(bench.folders))


def _probe() -> NoiseProbe:
    pipeline = create_pipeline("glomap", PIPELINE["settings"])
    gtf = GtfDefinition(clean_runs=1)
    return NoiseProbe(pipeline, pipeline.options.check(PIPELINE["options"]), gtf, runs=LADDER_RUNS, ladder=LADDER)


def _linearity(bench: Bench) -> None:
    with local_executor(bench.jobs) as executor:
        source = RunSource(bench.database, executor, run_limits(LimitsDefinition(run_timeout_s=3600)), bench.stop)
        _probe().measure(load_sequence(bench.folders[_OFFICE]), stored_runs(source))


def _read_linearity(bench: Bench) -> Linearity | None:
    """Return what the ladder says, None where it is not complete."""
    if not bench.folders or not (bench.folders[_OFFICE] / "groundtruth.txt").exists():
        return None
    sequence, seen = load_sequence(bench.folders[_OFFICE]), list[list[Trajectory]]()
    try:
        scale = _probe().measure(sequence, only_stored(bench.database, seen))
    except NotMeasuredError:
        return None
    return linearity_of(scale, sequence.ground_truth, seen) if sequence.ground_truth else None


def _timed(name: str, work: Callable[[], object]) -> None:
    began = time.perf_counter()
    work()
    print(f"{name}: {time.perf_counter() - began:.0f} s", flush=True)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Make the paper's figures and docs/paper.md (resumable).")
    parser.add_argument("--data", type=Path, help="folder of the paper's data sets (default: rendered stand-ins)")
    parser.add_argument("--points", type=int, default=12, help="values of each grid with --data")
    parser.add_argument("--folder", type=Path, default=FOLDER, help="where images and the database of results go")
    parser.add_argument("--write-only", action="store_true", help="run nothing, write what there is")
    return parser.parse_args()


if __name__ == "__main__":
    main()
