"""Run the experiments, or go on with them, and write the results."""

import argparse
import time
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path

from benchmarks.experiments.measure import Bench, data_folders, run_confirmation, run_grid
from benchmarks.experiments.plan import CONFIRMATION_RUNS, OPTIONS, batches, experiments
from gtf_tune.store.database import create_database
from gtf_tune.study.evaluation import Interrupted
from gtf_tune.study.stop import StopRequest, signals_to

DEFAULT_STORAGE = Path("storage/data/experiments.db")


def main() -> None:
    arguments = _arguments()
    folders = data_folders()
    planned = experiments(folders, arguments.sequences, arguments.options)
    arguments.storage.parent.mkdir(parents=True, exist_ok=True)
    bench = Bench(create_database(str(arguments.storage)), folders, StopRequest(), arguments.jobs)
    with signals_to(bench.stop, print), suppress(Interrupted):
        for batch in batches(planned):
            for experiment in batch:
                _timed(experiment.study, partial(run_grid, bench, experiment))
            for experiment in batch:
                name = f"{experiment.study} confirmation"
                _timed(name, partial(run_confirmation, bench, experiment, arguments.confirmation_runs))


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
    return parser.parse_args()


if __name__ == "__main__":
    main()
