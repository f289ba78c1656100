"""Run the experiments, or go on with them, and write the results."""

import argparse
import time
from contextlib import suppress
from pathlib import Path

from benchmarks.experiments.measure import Bench, data_folders, run_confirmation, run_grid
from benchmarks.experiments.plan import CONFIRMATION_RUNS, OPTIONS, experiments
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
        for experiment in planned:
            if bench.stop.level:
                break
            began = time.perf_counter()
            run_grid(bench, experiment)
            run_confirmation(bench, experiment, arguments.confirmation_runs)
            print(f"{experiment.study}: {time.perf_counter() - began:.0f} s", flush=True)


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
