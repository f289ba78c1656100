"""Compare a joint search of five options with the best sweep of a single one, for the same number of runs."""

from benchmarks.bare_study import define, search
from benchmarks.search_runs import ADAPTIVE, CASES, CLEAN_RUNS, FIXED
from benchmarks.section import Aim, Effort, Section, median
from gtf_tune.pipelines.analytic import OPTIMUM, expected_error

FIVE = next(case for case in CASES if case.name == "5 options")
BUDGETS = (100, 200, 400)
JOINT = "TPE, all five options, adaptive sizing"


def run(effort: Effort) -> Section:
    seeds = range(effort.pick(6, 20))
    nominal = expected_error({"refine.intrinsics": False})
    rows = {name: [_gain(found, nominal) for found in columns] for name, columns in _errors(list(seeds)).items()}
    sweeps = {name: gains for name, gains in rows.items() if name != JOINT}
    best = max(sweeps, key=lambda name: sweeps[name][-1])
    wins = [joint > swept for joint, swept in zip(rows[JOINT], sweeps[best], strict=True)]
    least = [budget for budget, won in zip(BUDGETS, wins, strict=True) if won]
    return Section(
        title="Five options at once against the best sweep of one",
        text=(
            f"Analytic pipeline, {len(seeds)} seeds, median. A sweep is a grid over one option, as fine as the runs "
            "allow; each of the five gets all of the runs. Shown is by how much the pick lowers the true error of "
            "nominal, in percent."
        ),
        header=("search", *(f"{budget} runs" for budget in BUDGETS)),
        rows=(
            *((name, *(f"{gain:.1f} %" for gain in gains)) for name, gains in rows.items()),
            ("possible", *(f"{_gain([_smallest()], nominal):.1f} %" for _ in BUDGETS)),
        ),
        aims=(
            Aim(
                wanted="five options at once beat the best sweep for the same number of runs",
                measured=f"at {', '.join(map(str, least)) or 'none'} of {', '.join(map(str, BUDGETS))} runs",
                met=all(wins),
                bound="" if all(wins) else "With fewer runs the search of five options has hardly begun.",
            ),
        ),
    )


def _errors(seeds: list[int]) -> dict[str, list[list[float]]]:
    """Return the true errors of the picks by search, then budget, then seed."""
    found: dict[str, list[list[float]]] = {}
    for option in FIVE.points:
        found[f"sweep of {option}"] = [[_sweep(option, seed, budget) for seed in seeds] for budget in BUDGETS]
    steps = [
        search(
            define(FIVE.space(seed), {"clean_runs": CLEAN_RUNS, **ADAPTIVE}, {"sampler": "tpe", "seed": seed}),
            BUDGETS[-1],
        )
        for seed in seeds
    ]
    found[JOINT] = [
        [[step for step in one if step.runs <= budget][-1].true_error for one in steps] for budget in BUDGETS
    ]
    return found


def _sweep(option: str, seed: int, budget: int) -> float:
    axis = FIVE.space(seed)[option]
    points = budget // (CLEAN_RUNS + int(FIXED["noisy_runs"])) - 1
    finer = axis if "values" in axis else {**axis, "points": max(points, 2)}
    definition = define({option: finer}, {"clean_runs": CLEAN_RUNS, **FIXED}, {"sampler": "grid", "seed": seed})
    return search(definition, budget)[-1].true_error


def _smallest() -> float:
    return expected_error(OPTIMUM)


def _gain(errors: list[float], nominal: float) -> float:
    return 100.0 * (1.0 - median(errors) / nominal)
