import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from gtf_tune.definition import GtfDefinition
from gtf_tune.gtf import GtfScore
from gtf_tune.study.outcome.judge import Findings, Measured, judge

GTF = GtfDefinition()
NOISY = 12


def score(size: float, *, seed: int = 0, spread: float = 0.05, collapsed: int = 0, coverage: float = 1.0) -> GtfScore:
    """Return a made-up score: noise instances are common to all, ``spread`` is this setting's own."""
    common = 0.3 * np.random.default_rng(99).standard_normal(NOISY)
    own = spread * np.random.default_rng(seed).standard_normal((2, NOISY))
    matrix = 0.01 * size * np.exp(common + own)
    flags = np.arange(NOISY) < collapsed
    return GtfScore(
        value=float(matrix.mean()),
        standard_error=math.nan,
        confidence_interval=(math.nan, math.nan),
        matrix=np.where(flags, 100 * matrix, matrix),
        pair_errors={},
        coverage_clean=np.full(2, coverage),
        coverage_noisy=np.full(NOISY, coverage),
        extents=np.ones((2, NOISY)),
        matched=np.full((2, NOISY), 50),
        num_frames=50,
        collapsed=flags,
    )


def findings(*candidates: dict[str, GtfScore], nominal: dict[str, GtfScore], **more: frozenset[str]) -> Findings:
    measured = tuple(Measured(number, {"option": number}, one) for number, one in enumerate(candidates, start=1))
    return Findings(Measured(0, {}, nominal), measured, **more)


def test_a_clear_improvement_is_adopted() -> None:
    result = judge(findings({"a": score(0.7, seed=1)}, nominal={"a": score(1.0)}), GTF)

    assert (result.word, result.adopted) == ("adopt", 1)
    assert result.candidates[0].improvement.value == pytest.approx(0.3, abs=0.05)


def test_no_difference_keeps_nominal() -> None:
    result = judge(findings({"a": score(1.0, seed=1, spread=0.2)}, nominal={"a": score(1.0)}), GTF)

    assert result.word == "keep nominal"
    assert result.candidates[0].reasons == ("not significantly better than nominal",)


def test_a_certain_but_tiny_improvement_is_not_worth_a_change() -> None:
    result = judge(findings({"a": score(0.99, seed=1, spread=0.001)}, nominal={"a": score(1.0, spread=0.001)}), GTF)

    assert result.word == "keep nominal"
    assert result.candidates[0].reasons == ("better by less than 2%, which is not worth a change",)


def test_the_best_of_several_adoptable_candidates_is_adopted() -> None:
    found = findings({"a": score(0.8, seed=1)}, {"a": score(0.6, seed=2)}, nominal={"a": score(1.0)})

    assert judge(found, GTF).adopted == 2


def test_the_surer_of_two_improvements_is_adopted() -> None:
    scattered, sure = {"a": score(0.7, seed=1, spread=0.4)}, {"a": score(0.8, seed=2, spread=0.02)}

    result = judge(findings(scattered, sure, nominal={"a": score(1.0, spread=0.02)}), GTF)

    larger, surer = result.candidates
    assert larger.passes
    assert surer.passes
    assert larger.improvement.value > surer.improvement.value
    assert result.adopted == 2


def test_several_candidates_raise_the_bar() -> None:
    candidate, nominal = {"a": score(0.95, seed=3, spread=0.07)}, {"a": score(1.0, spread=0.02)}
    alone = judge(findings(candidate, nominal=nominal), GTF).candidates[0]
    among = judge(findings(candidate, candidate, candidate, nominal=nominal), GTF).candidates[0]

    assert among.adjusted_p_value == pytest.approx(3 * alone.adjusted_p_value)


def test_more_collapsed_runs_than_nominal_prevent_an_adoption() -> None:
    result = judge(findings({"a": score(0.7, seed=1, collapsed=1)}, nominal={"a": score(1.0)}), GTF)

    assert result.word == "keep nominal"
    assert "collapsed" in result.candidates[0].reasons[0]


def test_a_run_below_the_coverage_floor_prevents_an_adoption() -> None:
    result = judge(findings({"a": score(0.7, seed=1, coverage=0.9)}, nominal={"a": score(1.0)}), GTF)

    assert result.word == "keep nominal"
    assert "90% of the frames, less than 95%" in result.candidates[0].reasons[0]


def test_a_run_just_below_the_floor_is_not_said_to_register_as_much_as_the_floor() -> None:
    result = judge(findings({"a": score(0.7, seed=1, coverage=18 / 19)}, nominal={"a": score(1.0)}), GTF)

    assert result.candidates[0].reasons == ("a run on a registered 94.7% of the frames, less than 95.0%",)


def test_a_regression_on_a_held_out_sequence_prevents_an_adoption() -> None:
    result = judge(
        findings(
            {"a": score(0.5, seed=1), "held": score(1.3, seed=2)},
            nominal={"a": score(1.0), "held": score(1.0)},
            holdouts=frozenset({"held"}),
        ),
        GTF,
    )

    assert result.word == "keep nominal"
    assert result.candidates[0].reasons == ("worse on held",)


def test_a_held_out_sequence_does_not_earn_an_adoption() -> None:
    result = judge(
        findings(
            {"a": score(1.0, seed=1, spread=0.2), "held": score(0.2, seed=2)},
            nominal={"a": score(1.0), "held": score(1.0)},
            holdouts=frozenset({"held"}),
        ),
        GTF,
    )

    assert result.word == "keep nominal"


def test_several_sequences_count_by_their_geometric_mean_whatever_their_units() -> None:
    nominal = {"a": score(1.0), "b": score(1000.0, seed=1)}
    candidate = {"a": score(0.5, seed=2), "b": score(900.0, seed=3)}

    found = judge(findings(candidate, nominal=nominal), GTF).candidates[0]

    assert 1 - found.improvement.value == pytest.approx(math.sqrt(0.5 * 0.9), rel=0.05)


def test_collapses_on_one_sequence_do_not_blur_what_is_found_on_the_others() -> None:
    names = ("a", "b", "c")
    nominal = {name: score(1.0, seed=number) for number, name in enumerate(names)}
    candidate = {name: score(0.8, seed=9 + number, collapsed=2 * (name == "c")) for number, name in enumerate(names)}

    (found,) = judge(findings(candidate, nominal=nominal), GTF).candidates

    assert found.improvement.value == pytest.approx(0.2, abs=0.02)
    assert found.improvement.high - found.improvement.low < 0.1
    assert found.improvement.instances == 3 * NOISY - 2
    assert found.reasons == (f"2 of {NOISY} noisy runs on c collapsed, 0 under nominal",)


def test_a_nominal_that_never_works_cannot_be_compared_with() -> None:
    nothing = score(1.0)
    nothing = replace(nothing, matrix=np.full((2, NOISY), np.nan), coverage_clean=np.zeros(2))

    result = judge(findings({"a": score(0.5)}, nominal={"a": nothing}), GTF)

    assert (result.word, result.adopted) == ("none", None)
    assert "cannot be compared with nominal" in result.candidates[0].reasons[0]


def test_a_nominal_that_works_once_cannot_be_compared_with_either() -> None:
    mostly_failed = score(1.0)
    mostly_failed.matrix[:, 1:] = np.nan

    result = judge(findings({"a": score(0.5)}, nominal={"a": mostly_failed}), GTF)

    assert (result.word, result.adopted) == ("none", None)
    assert result.candidates[0].reasons == (
        f"cannot be compared with nominal, which worked in 1 of {NOISY} noisy runs on a",
    )


def test_runs_that_share_few_frames_prevent_an_adoption() -> None:
    candidate = score(0.5, seed=1, coverage=0.8)
    candidate.matched[0, 3] = 15

    result = judge(findings({"a": candidate}, nominal={"a": score(1.0, coverage=0.8)}), GTF)

    assert result.word == "keep nominal"
    assert result.candidates[0].reasons == (
        "a noisy run on a shares 38% of its frames with a clean one, less than 50%",
    )


def test_noisy_runs_are_measured_by_what_nominal_registers_under_noise() -> None:
    nominal = replace(score(1.0), coverage_noisy=np.full(NOISY, 0.92))
    candidate = replace(score(0.7, seed=1), coverage_noisy=np.where(np.arange(NOISY) == 3, 0.5, 0.92))

    result = judge(findings({"a": candidate}, nominal={"a": nominal}), GTF)

    assert result.candidates[0].reasons == ("a run on a registered 50% of the frames, less than 87%",)


def test_runs_that_cannot_be_aligned_prevent_an_adoption() -> None:
    candidate = replace(score(0.7, seed=1), pair_errors={(0, 3): "on a line"})
    candidate.matrix[0, 3] = np.nan

    result = judge(findings({"a": candidate}, nominal={"a": score(1.0)}), GTF)

    assert result.word == "keep nominal"
    assert result.candidates[0].reasons == ("runs on a cannot be compared: on a line",)


def test_a_nominal_that_fails_on_a_held_out_sequence_only_is_kept() -> None:
    nothing = replace(score(1.0), matrix=np.full((2, NOISY), np.nan))
    no_better = {"a": score(1.0, seed=1, spread=0.2), "held": score(1.0)}

    result = judge(findings(no_better, nominal={"a": score(1.0), "held": nothing}, holdouts=frozenset({"held"})), GTF)

    assert result.word == "keep nominal"


def failed_at(found: GtfScore, run: int) -> GtfScore:
    """Return a score one of whose noisy runs gave no trajectory."""
    failed = np.arange(NOISY) == run
    return replace(
        found,
        matrix=np.where(failed, np.nan, found.matrix),
        coverage_noisy=np.where(failed, 0.0, found.coverage_noisy),
        matched=np.where(failed, 0, found.matched),
        pair_errors={(row, run): "no poses" for row in range(2)},
    )


def test_as_many_failed_runs_as_under_nominal_prevent_nothing() -> None:
    candidate = failed_at(score(0.5, seed=1), 5)

    elsewhere = judge(findings({"a": candidate}, nominal={"a": failed_at(score(1.0), 3)}), GTF)
    more = judge(findings({"a": candidate}, nominal={"a": score(1.0)}), GTF)

    assert (elsewhere.word, elsewhere.candidates[0].reasons) == ("adopt", ())
    assert more.word == "keep nominal"


def test_one_failed_run_of_nominal_does_not_open_the_door_to_settings_that_drop_frames() -> None:
    nominal = score(1.0)
    nominal = replace(nominal, coverage_clean=np.array([1.0, 0.0]))

    result = judge(findings({"a": score(0.5, seed=1, coverage=0.1)}, nominal={"a": nominal}), GTF)

    assert result.word == "keep nominal"
    assert result.candidates[0].reasons == ("a run on a registered 10% of the frames, less than 95%",)


def test_noisy_runs_need_no_more_frames_than_nominal_registers_under_noise() -> None:
    nominal = replace(score(1.0), coverage_noisy=np.full(NOISY, 0.92))
    candidate = replace(score(0.5, seed=1), coverage_noisy=np.full(NOISY, 0.96))

    assert judge(findings({"a": candidate}, nominal={"a": nominal}), GTF).word == "adopt"


def test_a_nominal_that_often_collapses_is_not_protected_by_its_own_median() -> None:
    nominal = score(1.0, collapsed=5)
    nominal = replace(nominal, collapsed=np.zeros(NOISY, dtype=bool))

    assert judge(findings({"a": score(0.5, seed=1, collapsed=1)}, nominal={"a": nominal}), GTF).word == "adopt"


def test_a_run_as_good_as_nominals_usual_ones_is_no_collapse() -> None:
    candidate = score(0.15, seed=1)
    candidate.matrix[:, 3] /= 0.15

    assert judge(findings({"a": candidate}, nominal={"a": score(1.0)}), GTF).word == "adopt"


def diverging() -> GtfScore:
    return score(50.0)


def half_lost() -> GtfScore:
    return replace(score(1.0), coverage_noisy=np.full(NOISY, 0.6))


def mostly_collapsed() -> GtfScore:
    return replace(score(1.0), collapsed=np.arange(NOISY) < 8)


@pytest.mark.parametrize(
    ("nominal", "fault"),
    [
        (diverging, "nominal's own trajectory moves by 496 per mille of its extent under noise, more than 100"),
        (half_lost, "noise costs the nominal options frames (100% without it, 60% in the median noisy run)"),
        (mostly_collapsed, "67% of nominal's noisy runs diverged"),
    ],
)
def test_nothing_is_adopted_where_the_score_says_little(nominal: Callable[[], GtfScore], fault: str) -> None:
    found = nominal()
    shrunk = replace(found, matrix=1e-3 * found.matrix, collapsed=np.zeros(NOISY, dtype=bool))

    result = judge(findings({"a": shrunk}, nominal={"a": found}), GTF)

    assert result.word == "keep nominal"
    assert result.candidates[0].improvement.value > 0.9
    assert result.doubts == (f"The score says little on a: {fault}.",)
    assert result.candidates[0].reasons == result.doubts


def test_without_candidates_nominal_is_kept() -> None:
    assert judge(Findings(None, ()), GTF).word == "keep nominal"


def test_an_option_with_a_margin_of_its_own_has_to_win_that_much() -> None:
    found = findings({"a": score(0.8, seed=1)}, nominal={"a": score(1.0)})

    asked = {margin: judge(replace(found, margins={"option": margin}), GTF) for margin in (0.1, 0.3)}
    other = judge(replace(found, margins={"another": 0.3}), GTF)

    assert [verdict.word for verdict in (asked[0.1], asked[0.3], other)] == ["adopt", "keep nominal", "adopt"]
    assert asked[0.3].candidates[0].reasons == ("better by less than 30%, which options before the mapper have to win",)
