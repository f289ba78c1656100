import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from experiments import report
from experiments.ablation import ablation
from experiments.estimators import between, dispersion, paired_ratio
from experiments.figures import gains, k_delta, noise, options
from experiments.findings import Findings, share_of_oracle, share_of_verdicts
from experiments.joint import Joint
from experiments.k_delta import curve, picks, r_squared_by_count
from experiments.ladder import Ladder, Rung
from experiments.plan import (
    OPTIONS,
    Experiment,
    batches,
    experiments,
    many_noisy_runs,
    other_sigmas,
    traps,
)
from experiments.settings import PREDICTORS, Outcome, Setting
from experiments.stored import outcome_from, stored_curves, stored_ladders, stored_results
from experiments.tables import joint_table, shortfall_table, trap_table
from experiments.unseen import SCORERS, on_unseen, share_on_unseen, unseen_table
from experiments.weaker import noise_pairs, noise_sentence, noise_table, standings
from gtf_tune.trajectory import Trajectory

HUBER = Experiment("dtu-scan24", OPTIONS["huber"], 2.0)
FOUND = {name: Path(name) for name in ("room", "dtu-scan24", "fountain-P11", "hut")}


def setting(
    number: int,
    true_ate: float,
    collapsed: int = 0,
    *,
    feasible: bool = True,
    runs: int = 8,
    noisy_true_ates: Sequence[float] | None = None,
) -> Setting:
    """Return a setting whose score follows its true error, except where runs collapsed."""
    matrix = 1e-3 * true_ate * np.exp(0.1 * np.random.default_rng(number).standard_normal((2, runs)))
    matrix[:, :collapsed] *= 300
    return Setting(
        number=number,
        value=float(number + 1),
        feasible=feasible,
        coverage=1.0 if feasible else 0.5,
        true_ate=true_ate,
        noisy_true_ates=np.full(runs, true_ate) if noisy_true_ates is None else np.array(noisy_true_ates),
        matrix=matrix,
        collapsed=collapsed / runs,
        clean_clean=1e-4,
        noisy_noisy=2e-3 * true_ate,
        dispersion=1e-3 * true_ate,
        paired=true_ate,
        reprojection_px=1.0 / (number + 1),
    )


def outcome(*settings: Setting, adopted: Setting | None = None, verdict: str = "unconfirmed") -> Outcome:
    return Outcome(HUBER, settings, adopted, verdict)


def test_one_collapsed_run_misleads_the_mean_but_not_the_median() -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.5, collapsed=1), setting(2, 2.0))

    assert found.agreement(PREDICTORS["mean"]).pick.number == 0
    assert found.agreement(PREDICTORS["median"]).pick.number == 1


def test_infeasible_settings_are_neither_picked_nor_the_oracle() -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.1, feasible=False), setting(2, 0.8))

    assert found.oracle.number == 2
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
    assert {one.sequence for one in first} == {"room", "dtu-scan24", "fountain-P11"}
    assert sum(map(len, [first, *others])) == 5 * len(FOUND)


def test_every_experiment_has_a_study_of_its_own() -> None:
    planned = [
        *experiments(FOUND),
        *many_noisy_runs(FOUND),
        *other_sigmas(FOUND),
        *traps(FOUND),
        *ablation(FOUND),
    ]

    assert len({one.study for one in planned}) == len(planned)


def test_results_say_what_is_adopted_and_what_is_missing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = [setting(0, 1.0), setting(1, 0.5)]
    confirmed = outcome(*settings, adopted=settings[1], verdict="adopt")

    findings = Findings([confirmed], [], [], [], [confirmed], [], [], ["hut.ba.s5"])
    monkeypatch.setattr(report, "write_figures", lambda *_: [])

    report.write_results(findings, tmp_path)

    page = (tmp_path / "results-appendix.md").read_text()
    assert "adopt -50.0%" in page
    assert "a nominal setting that works: hut.ba.s5" in page
    assert (tmp_path / "results.json").stat().st_size > 100


def moved(seed: int, size: float) -> Trajectory:
    """Return a curve whose 30 positions are moved by random amounts of this size, in a similarity frame of its own."""
    generator = np.random.default_rng(seed)
    angles = np.linspace(0, 4, 30)
    curve = np.stack([np.cos(angles), np.sin(angles), 0.3 * angles], axis=1)
    positions = (1 + seed) * (curve + size * generator.standard_normal(curve.shape)) + seed
    return Trajectory(np.arange(30), np.arange(30.0), positions, np.tile([0.0, 0.0, 0.0, 1.0], (30, 1)))


@pytest.mark.parametrize("estimator", [between, dispersion])
def test_estimators_grow_with_the_spread_of_runs_and_ignore_scale(estimator: Callable[..., float]) -> None:
    small, large = ([moved(seed, size) for seed in range(5)] for size in (1e-3, 1e-2))

    assert estimator(large) / estimator(small) == pytest.approx(10, rel=0.1)


def test_one_run_that_fell_apart_hardly_moves_the_dispersion() -> None:
    sound = [moved(seed, 1e-3) for seed in range(6)]

    assert dispersion([*sound, moved(7, 0.5)]) < 2 * dispersion(sound)


def test_paired_ratios_leave_out_what_collapsed() -> None:
    nominal = np.exp(0.3 * np.random.default_rng(0).standard_normal((2, 8)))
    better = 0.8 * nominal
    better[:, 2] *= 300

    assert paired_ratio(nominal, better) == pytest.approx(0.8)


def test_a_loss_counts_as_the_whole_gain_at_the_most() -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.5), setting(2, 5.0))
    worst = replace(found.settings[2], paired=0.1)

    share, grids = share_of_oracle([replace(found, settings=(*found.settings[:2], worst))], "paired")

    assert (share, grids) == (-1.0, 1)


def test_a_verdict_that_keeps_nominal_reaches_nothing_of_the_oracles_gain() -> None:
    settings = [setting(0, 1.0), setting(1, 0.5)]
    kept = outcome(*settings, adopted=settings[0], verdict="keep nominal")
    taken = outcome(*settings, adopted=settings[1], verdict="adopt")

    assert share_of_verdicts([kept, taken, outcome(*settings)]) == (0.5, 2)


def test_the_trap_table_says_which_settings_are_infeasible() -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.2, feasible=False))

    _, rows = trap_table([found])

    assert [row[-1] for row in rows] == ["feasible and picked", "infeasible"]


@pytest.mark.parametrize(
    ("oracle", "told"),
    [
        ((0.3, 0.3, 0.4, 0.5, 1.2, 1.3), "more do not help"),
        ((-0.6, -0.6, 0.16, 0.16, 0.4, 0.4), "enough, compared in pairs"),
    ],
)
def test_noisy_runs_are_useless_only_where_pairs_prefer_the_pick(oracle: tuple[float, ...], told: str) -> None:
    pick = (0.0, 0.0, 0.1, 0.2, 1.0, 1.0)
    settings = [
        replace(setting(number, true_ate), matrix=np.exp(np.tile(logs, (2, 1))))
        for number, (true_ate, logs) in enumerate([(1.0, [2.0] * 6), (0.9, pick), (0.5, oracle)])
    ]

    ((*_, needed),) = shortfall_table([outcome(*settings)])[1]

    assert needed == told


def test_a_gap_that_is_not_certain_has_an_interval_that_holds_zero() -> None:
    matrix = np.ones((2, 6))
    apart = np.exp(0.55 + 0.7 * np.array([-1.0, -1.0, -1.0, 1.0, 1.0, 1.0]))
    settings = [
        replace(setting(0, 1.0, runs=6), matrix=2 * matrix),
        replace(setting(1, 0.9, runs=6), matrix=matrix),
        replace(setting(2, 0.5, runs=6), matrix=apart * matrix),
    ]

    ((*_, gap, _, needed),) = shortfall_table([outcome(*settings)])[1]

    assert needed == "about 16"
    assert gap == "+73.3% (-22.5% to +287.6%)"


def test_picks_are_judged_on_the_half_of_the_noisy_runs_that_did_not_choose() -> None:
    nominal = setting(0, 1.0)
    lucky = setting(1, 0.9, noisy_true_ates=[0.2] + 7 * [2.0])
    steady = setting(2, 0.95, noisy_true_ates=8 * [0.5])

    found = on_unseen(outcome(nominal, lucky, steady), lambda one, *_: -one.number)

    assert found is not None
    assert found.by_score == pytest.approx(-0.5)
    assert found.by_clean_truth == pytest.approx(1.0)
    assert found.by_seen_truth == found.hindsight == pytest.approx(-0.5)


def test_a_pick_by_runs_that_say_nothing_of_the_others_reaches_little_of_what_hindsight_does() -> None:
    generator = np.random.default_rng(0)
    settings = [
        replace(setting(number, 1.0, noisy_true_ates=errors), matrix=np.tile(errors, (2, 1)))
        for number, errors in enumerate(generator.uniform(0.5, 1.5, (7, 8)))
    ]

    share, grids = share_on_unseen([outcome(*settings)], SCORERS["median"])
    _, rows = unseen_table([outcome(*settings)])

    assert grids == 1
    assert share < 0.5
    assert rows[0][:2] == ["share of hindsight, 1 grids", f"{share:.0%}"]


def test_nothing_is_said_of_unseen_images_where_their_truth_is_not_known() -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.5, noisy_true_ates=()))

    assert unseen_table([found])[1] == []


def test_a_joint_search_stands_beside_the_sweeps_of_its_sequence() -> None:
    joint = Joint("dtu-scan24", "tpe", 35, 280, 2.0, 1.0, 0.5, {}, "adopt", 1.0)

    _, rows = joint_table([joint], [outcome(setting(0, 1.0), setting(1, 0.9))])

    assert rows[0][2:4] == ["20", "-10.0%"]
    assert rows[1][2:] == ["280", "**-50.0%**", "-75.0%", "adopt -50.0%"]


def test_figures_hold_what_was_measured() -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.5), verdict="keep nominal", adopted=setting(0, 1.0))
    ladder = Ladder("room", 1e-4, (Rung(1.0, 1e-3, 0.3, 0, True, 0.5),), 1.0)
    findings = Findings([found], [found], [], [], [found], [], [ladder], [], [curve(found)])

    assert gains(findings).data[0].x == (-50.0,)
    assert len(k_delta(findings).data) == 4
    assert options(findings).data[0].base == (-50.0,)
    assert list(noise(findings).data[0].y) == [1.0]


def test_ladders_and_curves_are_kept_where_their_database_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = outcome(setting(0, 1.0), setting(1, 0.5))
    ladder = Ladder("room", 1e-4, (Rung(1.0, 1e-3, 0.3, 0, True, 0.5),), 1.0)
    monkeypatch.setattr(report, "write_figures", lambda *_: [])

    report.write_results(Findings([found], [found], [], [], [], [], [ladder], [], [curve(found)]), tmp_path)

    assert stored_ladders(tmp_path / "results.json") == [ladder]
    assert stored_curves(tmp_path / "results.json")[0].counts == tuple(range(1, 9))


def test_outcomes_read_back_from_the_results_are_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = [setting(0, 1.0), setting(1, 0.5, collapsed=1), setting(2, 0.2, feasible=False)]
    confirmed = outcome(*settings, adopted=settings[1], verdict="adopt")
    monkeypatch.setattr(report, "write_figures", lambda *_: [])
    report.write_results(Findings([confirmed], [], [], [], [], [], [], []), tmp_path)

    found = outcome_from(stored_results(tmp_path / "results.json")[HUBER.study], HUBER)

    assert found.adopted is not None
    assert found.adopted.number == 1
    assert [one.true_ate for one in found.settings] == [1.0, 0.5, 0.2]
    assert np.array_equal(found.settings[1].matrix, settings[1].matrix)
    assert [one.feasible for one in found.settings] == [True, True, False]
    assert [one.noisy_true_ates[0] for one in found.settings] == [1.0, 0.5, 0.2]


def test_the_share_under_weaker_noise_is_over_the_grids_that_have_both() -> None:
    settings = (setting(0, 1.0), setting(1, 0.5), setting(2, 0.8))
    misled = tuple(replace(one, matrix=one.matrix * (10 if one.number == 1 else 1)) for one in settings)
    usual, alone = Outcome(HUBER, misled, None, "unconfirmed"), Outcome(HUBER, settings, None, "unconfirmed")
    weaker = replace(alone, experiment=replace(HUBER, sigma=0.5))
    elsewhere = replace(alone, experiment=replace(HUBER, sequence="hut"))

    pairs = noise_pairs([usual, elsewhere], [weaker])

    before, after = standings(pairs)
    assert [(one.usual, one.weaker) for one in pairs] == [(usual, weaker)]
    assert (before.share, after.share) == (pytest.approx(0.4), pytest.approx(1.0))
    assert before.spearman < after.spearman == pytest.approx(1.0)
    assert [row[5:8] for row in noise_table(pairs)[1]][1:] == [["40%", "100%", "100%"], ["-20.0%", "-50.0%", "-50.0%"]]
    assert noise_pairs([elsewhere], [weaker]) == []
    assert noise_sentence([]) == ""
