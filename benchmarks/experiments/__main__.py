"""Run the experiments, or go on with them, and write the results."""

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path

from benchmarks.experiments.ablation import ablation, swept_elsewhere
from benchmarks.experiments.ladder import SEQUENCES as LADDER_SEQUENCES
from benchmarks.experiments.ladder import Ladder, NotMeasuredError, read_ladder, run_ladder
from benchmarks.experiments.measure import Bench, data_folders, run_confirmation, run_grid
from benchmarks.experiments.plan import (
    CONFIRMATION_RUNS,
    OPTIONS,
    Experiment,
    batches,
    experiments,
    many_noisy_runs,
)
from benchmarks.experiments.report import Findings, write_results
from benchmarks.experiments.settings import Outcome, read_outcome
from gtf_tune.store.database import Database, create_database
from gtf_tune.study.evaluation import Interrupted
from gtf_tune.study.stop import StopRequest, signals_to

DEFAULT_STORAGE = Path("storage/data/experiments.db")
DOCS = Path("docs")


def main() -> None:
    arguments = _arguments()
    folders = data_folders()
    planned = experiments(folders, arguments.sequences, arguments.options)
    arguments.storage.parent.mkdir(parents=True, exist_ok=True)
    bench = Bench(create_database(str(arguments.storage)), folders, StopRequest(), arguments.jobs)
    if not arguments.write_only:
        _measure(bench, planned, arguments.confirmation_runs)
    _write(bench, folders)


def _measure(bench: Bench, planned: list[Experiment], confirmation_runs: int) -> None:
    with signals_to(bench.stop, print), suppress(Interrupted):
        for batch in batches(planned):
            for experiment in batch:
                _timed(experiment.study, partial(run_grid, bench, experiment))
            for experiment in batch:
                name = f"{experiment.study} confirmation"
                _timed(name, partial(run_confirmation, bench, experiment, confirmation_runs))
            _write(bench, bench.folders)
        for experiment in many_noisy_runs(bench.folders):
            _timed(experiment.study, partial(run_grid, bench, experiment))
        for name in (name for name in LADDER_SEQUENCES if name in bench.folders):
            _timed(f"noise ladder of {name}", partial(run_ladder, bench, name))
        for experiment in ablation(bench.folders):
            _timed(experiment.study, partial(run_grid, bench, experiment))


def _write(bench: Bench, folders: Mapping[str, Path]) -> None:
    """Write the results as far as there are any, also in the middle of the work."""
    table, many, single = experiments(folders), many_noisy_runs(folders), ablation(folders)
    read = partial(_read_all, bench.database)
    ladders, missing_ladders = _ladders(bench, folders)
    done = {one.experiment.study for one in read([*table, *many, *single])}
    missing = [one.study for one in (*table, *many, *single) if one.study not in done]
    ablated = read([*single, *swept_elsewhere(folders)])
    write_results(Findings(read(table), read(many), ablated, ladders, [*missing, *missing_ladders]), DOCS)


def _read_all(database: Database, planned: Sequence[Experiment]) -> list[Outcome]:
    return [outcome for one in planned if (outcome := read_outcome(database, one)) is not None]


def _ladders(bench: Bench, folders: Mapping[str, Path]) -> tuple[list[Ladder], list[str]]:
    found, missing = [], []
    for name in (name for name in LADDER_SEQUENCES if name in folders):
        try:
            found.append(read_ladder(bench.database, folders, name))
        except NotMeasuredError:
            missing.append(f"noise ladder of {name}")
    return found, missing


def _timed(name: str, work: Callable[[], None]) -> None:
    began = time.perf_counter()
    work()
    print(f"{name}: {time.perf_counter() - began:.0f} s", flush=True)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description="Repeat the paper's experiments on GTF_TUNE_DATA (hours; resumable).")
    parser.add_argument("--sequences", nargs="*", default=[], help="names of sequences (default: all)")
    parser.add_argument("--options", nargs="*", default=[], choices=list(OPTIONS), help="options (default: all five)")
    parser.add_argument("--storage", type=Path, default=DEFAULT_STORAGE, help="database that results accumulate in")
    parser.add_argument("--jobs", type=int, default=1, help="runs side by side")
    parser.add_argument("--confirmation-runs", type=int, default=CONFIRMATION_RUNS, help="noisy runs of a confirmation")
    parser.add_argument("--write-only", action="store_true", help="run nothing, write what there is")
    return parser.parse_args()


if __name__ == "__main__":
    main()
