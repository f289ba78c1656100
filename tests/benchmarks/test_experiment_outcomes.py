import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.experiments.ablation import ablation
from benchmarks.experiments.k_delta import picks, r_squared_by_count
from benchmarks.experiments.plan import OPTIONS, Experiment, batches, experiments, many_noisy_runs
from benchmarks.experiments.report import Findings, write_results
from benchmarks.experiments.settings import PREDICTORS, Outcome, Setting

HUBER = Experiment("dtu-scan24", OPTIONS["huber"], 2.0)
FOUND = {name: Path(name) for name in ("dtu-scan24", "fountain-P11", "hut")}


def setting(ordinal: int, true_ate: float, collapsed: int = 0, *, feasible: bool = True, runs: int = 8) -> Setting:
    """Return a setting whose score follows its true error, except where runs collapsed."""
    matrix = 1e-3 * true_ate * np.exp(0.1 * np.random.default_rng(ordinal).standard_normal((2, runs)))
    matrix[:, :collapsed] *= 300
    return Setting(
        ordinal=ordinal,
        value=float(ordinal + 1),
        feasible=feasible,
        coverage=1.0 if feasible else 0.5,
        true_ate=true_ate,
        matrix=matrix,
        collapsed=collapsed / runs,
        clean_clean=1e-4,
        reprojection_px=1.0 / (ordinal + 1),
    )


def outcome(*settings: Setting, adopted: Setting | None = None, verdict: str = "unconfirmed") -> Outcome:
    return Outcome(HUBER, settings, adopted, verdict)


def test_one_collapsed_run_misleads_the_mean_but_not_the_median() -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.5, collapsed=1), setting(2, 2.0))

    assert found.agreement(PREDICTORS["mean"]).pick.ordinal == 0
    assert found.agreement(PREDICTORS["median"]).pick.ordinal == 1


def test_infeasible_settings_are_neither_picked_nor_the_oracle() -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.1, feasible=False), setting(2, 0.8))

    assert found.oracle.ordinal == 2
    assert found.change(found.oracle) == pytest.approx(-0.2)


def test_a_predictor_that_never_changes_has_no_correlation() -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.5)).agreement(PREDICTORS["clean-clean"])

    assert math.isnan(found.correlation)


def test_more_noisy_runs_agree_better_with_the_truth() -> None:
    found = outcome(*(setting(number, 1.0 + 0.05 * number) for number in range(6)))

    few, many = r_squared_by_count(found, "gmean", (1, 8))

    assert few < many <= 1


def test_picks_by_the_mean_regress_where_good_settings_collapse_now_and_then() -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.5, collapsed=2), setting(2, 1.1), setting(3, 0.9))

    assert picks(found, "median", 4).mean < picks(found, "mean", 4).mean


def test_the_cheap_grids_of_small_sequences_come_first() -> None:
    first, *others = batches(experiments(FOUND))

    assert {one.option.short for one in first} == {"ba", "huber", "twoview"}
    assert {one.sequence for one in first} == {"dtu-scan24", "fountain-P11"}
    assert sum(map(len, [first, *others])) == 5 * len(FOUND)


def test_every_experiment_has_a_study_of_its_own() -> None:
    planned = [*experiments(FOUND), *many_noisy_runs(FOUND), *ablation(FOUND)]

    assert len({one.study for one in planned}) == len(planned)


def test_results_say_what_is_adopted_and_what_is_missing(tmp_path: Path) -> None:
    settings = [setting(0, 1.0), setting(1, 0.5)]
    confirmed = outcome(*settings, adopted=settings[1], verdict="adopt")

    write_results(Findings([confirmed], [confirmed], [confirmed], [], ["hut.ba.s5"]), tmp_path)

    page = (tmp_path / "results.md").read_text()
    assert "adopt -50.0%" in page
    assert "Not measured yet: hut.ba.s5" in page
    assert (tmp_path / "results.json").stat().st_size > 100
