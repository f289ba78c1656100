"""Run the experiments, or go on with them, and write the results."""

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, TypeVar

from experiments import several
from experiments.ablation import ablation, swept_elsewhere
from experiments.calibration import main as calibrate
from experiments.findings import Findings
from experiments.fresh import read_fresh
from experiments.joint import SEQUENCES as JOINT_SEQUENCES
from experiments.joint import read_joint, run_joint
from experiments.k_delta import curve
from experiments.ladder import SEQUENCES as LADDER_SEQUENCES
from experiments.ladder import Ladder, NotMeasuredError, read_ladder, run_ladder
from experiments.measure import Bench, data_folders, ground_truths, run_confirmation, run_grid
from experiments.plan import (
    CONFIRMATION_RUNS,
    OPTIONS,
    SIGMAS,
    Experiment,
    batches,
    confirmed_with_weaker_noise,
    experiments,
    many_noisy_runs,
    other_sigmas,
    traps,
)
from experiments.report import write_results
from experiments.settings import Outcome, read_outcome
from experiments.stored import (
    outcome_from,
    stored_candidates,
    stored_curves,
    stored_fresh,
    stored_joints,
    stored_ladders,
    stored_results,
)
from gtf_tune.store.database import Database, create_database
from gtf_tune.study.runs.run_source import Interrupted
from gtf_tune.study.runs.stop import StopRequest, signals_to
from gtf_tune.trajectory import Trajectory

Item = TypeVar("Item")

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
    folders = bench.folders
    with signals_to(bench.stop, print), suppress(Interrupted):
        for batch in batches(planned):
            _grids(bench, batch)
            _confirmations(bench, batch, confirmation_runs)
            _write(bench, folders)
        _grids(bench, traps(folders))
        for name in (name for name in JOINT_SEQUENCES if name in folders):
            _timed(f"joint search on {name}", partial(run_joint, bench, name, confirmation_runs))
        if set(several.needed()) <= set(folders):
            _timed("one setting for several sequences", partial(several.run_several, bench))
        _grids(bench, [*many_noisy_runs(folders), *other_sigmas(folders), *ablation(folders)])
        _confirmations(bench, confirmed_with_weaker_noise(folders), confirmation_runs)
        for name in (name for name in LADDER_SEQUENCES if name in folders):
            _timed(f"noise ladder of {name}", partial(run_ladder, bench, name))


def _grids(bench: Bench, planned: Sequence[Experiment]) -> None:
    for experiment in planned:
        _timed(experiment.study, partial(run_grid, bench, experiment))


def _confirmations(bench: Bench, planned: Sequence[Experiment], noisy_runs: int) -> None:
    for experiment in planned:
        _timed(f"{experiment.study} confirmation", partial(run_confirmation, bench, experiment, noisy_runs))


def _write(bench: Bench, folders: Mapping[str, Path]) -> None:
    """Write the results as far as there are any, also in the middle of the work and of sequences that are not here."""
    named = {name: Path(name) for name in SIGMAS}
    table, single = experiments(named), ablation(named)
    others = [many_noisy_runs(named), other_sigmas(named), traps(named)]
    truths = ground_truths(folders)
    read = partial(_read_all, bench.database, stored_results(DOCS / "results.json"), truths)
    outcomes = read(table)
    many, weaker, trapped = map(read, others)
    ladders, missing_ladders = _ladders(bench, folders)
    found = [read_joint(bench.database, name) for name in JOINT_SEQUENCES]
    joints = _merged(
        [one for one in found if one is not None], stored_joints(DOCS / "results.json"), lambda one: one.sequence
    )
    candidates = several.read_several(bench.database, outcomes) or stored_candidates(DOCS / "results.json")
    fresh = [
        one for found in outcomes for one in read_fresh(bench.database, found, truths.get(found.experiment.sequence))
    ]
    fresh = _merged(fresh, stored_fresh(DOCS / "results.json"), lambda one: one.study)
    ablated = read([*single, *swept_elsewhere(named)])
    done = {one.experiment.study for one in (*outcomes, *many, *weaker, *trapped, *ablated)}
    missing = [one.study for group in (table, *others, single) for one in group if one.study not in done]
    missing += [
        f"joint search on {name}" for name in JOINT_SEQUENCES if name not in {joint.sequence for joint in joints}
    ]
    missing += [] if candidates else ["one setting for several sequences"]
    curves = _merged([curve(one) for one in many], stored_curves(DOCS / "results.json"), lambda one: one.study)
    ladders = _merged(ladders, stored_ladders(DOCS / "results.json"), lambda one: one.sequence)
    measured = {f"noise ladder of {ladder.sequence}" for ladder in ladders}
    missing_ladders = [name for name in missing_ladders if name not in measured]
    write_results(
        Findings(
            outcomes,
            many,
            weaker,
            trapped,
            ablated,
            joints,
            ladders,
            [*missing, *missing_ladders],
            curves,
            candidates,
            fresh,
        ),
        DOCS,
    )
    calibrate()


def _read_all(
    database: Database,
    stored: Mapping[str, Mapping[str, Any]],
    truths: Mapping[str, Trajectory],
    planned: Sequence[Experiment],
) -> list[Outcome]:
    """Return finished experiments from the database, else from the results that are written already.

    Those whose nominal setting does not work are left out: there is nothing to compare with.
    """
    found = [
        _known(read_outcome(database, one, truths.get(one.sequence)), _stored(stored, one), one.sequence in truths)
        for one in planned
    ]
    return [one for one in found if one is not None and one.works]


def _known(fresh: Outcome | None, earlier: Outcome | None, judged: bool) -> Outcome | None:
    """Return what the database holds, with the earlier verdict where it holds none.

    What is not ``judged``, as its ground truth is not at hand, is taken as it was written earlier.
    """
    if earlier is not None and not judged:
        return earlier
    if fresh is None or fresh.adopted is not None or earlier is None or earlier.adopted is None:
        return fresh or earlier
    adopted = next((setting for setting in fresh.settings if setting.value == earlier.adopted.value), None)
    return fresh if adopted is None else replace(fresh, adopted=adopted, verdict=earlier.verdict)


def _merged(fresh: list[Item], earlier: list[Item], key: Callable[[Item], str]) -> list[Item]:
    """Return what was measured now, and what only an earlier run of this command has."""
    known = {key(one) for one in fresh}
    return [*fresh, *(one for one in earlier if key(one) not in known)]


def _stored(stored: Mapping[str, Mapping[str, Any]], experiment: Experiment) -> Outcome | None:
    return outcome_from(stored[experiment.study], experiment) if experiment.study in stored else None


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
