from dataclasses import replace

import numpy as np
import pytest

from gtf_tune.definition import GtfDefinition
from gtf_tune.study.runs.run_source import SequenceRuns
from gtf_tune.study.scoring.objective import (
    CoverageFloor,
    counted_frames,
    coverage_floor,
    least_floor,
    score_sequence,
    score_trial,
)
from gtf_tune.trajectory import Trajectory

FRAMES = 50
GTF = GtfDefinition(aggregate="median")


def run(frames: range, seed: int) -> Trajectory:
    """Return a run that registered these frames of a curve, a little wrong."""
    angles = 4.0 * np.arange(frames.start, frames.stop) / FRAMES
    positions = np.stack([np.cos(angles), np.sin(angles), 0.3 * angles], axis=1)
    positions += 1e-3 * np.random.default_rng(seed).standard_normal(positions.shape)
    ids = np.array(frames)
    return Trajectory(ids, ids.astype(float), positions, np.tile([0.0, 0.0, 0.0, 1.0], (len(ids), 1)))


def runs(clean: list[Trajectory], noisy: list[Trajectory], num_frames: int = FRAMES) -> SequenceRuns:
    return SequenceRuns(tuple(clean), tuple(noisy), num_frames)


def test_each_kind_of_run_goes_by_nominals_runs_of_that_kind() -> None:
    floor = coverage_floor([1.0, 0.98], [0.9, 0.8], 0.95, rules=1)

    assert floor == CoverageFloor(pytest.approx(0.931), pytest.approx(0.76))


def test_the_floor_follows_the_quartiles_of_nominals_coverage_and_not_its_worst_run() -> None:
    calm = coverage_floor([1.0, 1.0], [1.0] * 5 + [0.6], 0.95)
    varying = coverage_floor([1.0, 1.0], [0.90, 0.92, 0.94, 0.96, 0.98], 0.95)

    assert calm == CoverageFloor(0.95, 0.95)
    assert varying.noisy == pytest.approx(0.95 * (0.92 - 0.04))


def test_the_floor_gives_way_to_any_spread_by_a_tenth_at_most() -> None:
    assert coverage_floor([1.0], [0.6, 0.7, 0.9, 1.0], 1.0).noisy == pytest.approx(0.675 - 0.1)


def slam(start: int, seed: int, error: float = 1e-3) -> Trajectory:
    """Return a run that registers all frames from ``start``, the last twenty with ten times the error."""
    whole = run(range(start, FRAMES), seed)
    noise = np.random.default_rng(seed).standard_normal(whole.positions.shape)
    hard = np.where(whole.frame_ids >= FRAMES - 20, 10.0, 0.0)[:, None] * error
    return replace(whole, positions=whole.positions + hard * noise)


NOMINAL = runs([slam(1, 0), slam(3, 1)], [slam(2, 2), slam(4, 3), slam(0, 4), run(range(3), 5)])


def floor_of(nominal: SequenceRuns) -> CoverageFloor:
    floor = coverage_floor(nominal.clean_coverage, nominal.noisy_coverage, GTF.coverage_floor)
    return replace(floor, frames=counted_frames(nominal))


def test_configurations_are_scored_by_the_frames_that_all_dependable_runs_of_nominal_registered() -> None:
    floor = floor_of(NOMINAL)
    early = runs([slam(0, 6), slam(1, 7)], [slam(0, 8)])
    moved = [np.where(one.frame_ids[:, None] < 4, 0.1, 0.0) for one in early.clean]
    clean = [replace(one, positions=one.positions + by) for one, by in zip(early.clean, moved, strict=True)]
    wrong_at_start = replace(early, clean=tuple(clean))

    scores = [score_sequence(one, floor, GTF) for one in (early, wrong_at_start)]

    assert floor.frames == frozenset(range(4, FRAMES))
    assert all(one.feasible and one.coverage == pytest.approx(0.98) for one in scores)
    assert scores[0].score is not None
    assert scores[1].score is not None
    assert scores[0].score.value == scores[1].score.value


def test_a_configuration_that_begins_later_than_nominal_is_scored_where_both_have_frames() -> None:
    floor = floor_of(NOMINAL)

    assert score_sequence(runs([slam(5, 6), slam(5, 7)], [slam(5, 8)]), floor, GTF).feasible
    assert not score_sequence(runs([slam(12, 6), slam(12, 7)], [slam(12, 8)]), floor, GTF).feasible


def test_coverage_cannot_be_traded_for_error() -> None:
    floor, own = floor_of(NOMINAL), replace(least_floor(FRAMES), frames=counted_frames(NOMINAL))
    nominal = score_sequence(replace(NOMINAL, noisy=NOMINAL.noisy[:3]), own, GTF)
    without_the_hard_part = runs([run(range(3, FRAMES - 20), 6)] * 2, [run(range(3, FRAMES - 20), 7)])

    found = score_sequence(without_the_hard_part, floor, GTF)
    alone = score_sequence(without_the_hard_part, least_floor(FRAMES), GTF)

    assert nominal.score is not None
    assert alone.score is not None
    assert alone.score.value < nominal.score.value / 3
    assert not found.feasible
    values = [score_trial({"room": one}, None, GTF).value for one in (nominal, found)]
    assert values[0] < values[1]


def test_runs_of_nominal_that_share_little_choose_no_frames() -> None:
    assert counted_frames(runs([run(range(30), 0)], [run(range(20, 50), 1)])) is None


@pytest.mark.parametrize("bad", [0.0, 0.12])
def test_a_nominal_run_that_failed_or_lost_the_sequence_sets_no_example(bad: float) -> None:
    assert coverage_floor([1.0, 1.0], [0.9, bad, 0.9], 1.0) == CoverageFloor(1.0, 0.9)


def test_where_no_run_of_a_kind_worked_the_other_kind_counts() -> None:
    assert coverage_floor([0.0, 0.0], [0.8, 0.9], 1.0, rules=1) == CoverageFloor(0.8, 0.8)


def test_a_nominal_that_never_works_asks_for_what_an_alignment_needs() -> None:
    floor = coverage_floor([0.0], [], 0.95).at_least(least_floor(FRAMES))

    assert floor == CoverageFloor(4 / FRAMES, 4 / FRAMES)


def test_the_run_that_lacks_most_is_named_with_the_floor_of_its_kind() -> None:
    found = score_sequence(runs([run(range(48), 0)], [run(range(35), 1)], FRAMES), CoverageFloor(0.95, 0.9), GTF)

    assert found.message == "a run registered 70% of the frames, less than 90%"
    assert found.violation == pytest.approx(0.2)


def test_a_run_just_below_the_floor_is_not_said_to_register_as_much_as_the_floor() -> None:
    found = score_sequence(runs([run(range(19), 0)], [run(range(18), 1)], 19), CoverageFloor(0.95, 0.95), GTF)

    assert found.message == "a run registered 94.7% of the frames, less than 95.0%"


def test_a_few_common_frames_make_no_score() -> None:
    floor = CoverageFloor(0.5, 0.5)
    halves = ([run(range(27), 0)], [run(range(23, 50), 1)])

    found = score_sequence(runs(*halves), floor, GTF)

    assert not found.feasible
    assert found.message == "a noisy run shares 4 of its frames with a clean one, less than half of 27"
    assert not score_trial({"room": found}, None, GTF).feasible
    assert score_sequence(runs(halves[0], [run(range(27), 1)]), floor, GTF).feasible


def test_an_error_of_exactly_zero_is_a_score_over_several_sequences_too() -> None:
    same = run(range(FRAMES), 0)
    found = score_sequence(runs([same], [same]), CoverageFloor(0.9, 0.9), GTF)
    assert found.score is not None
    still = replace(found, score=replace(found.score, value=0.0))

    assert 0 < score_trial({"a": still, "b": still}, {"a": 0.0, "b": 0.5}, GTF).value < 1
    assert score_trial({"a": still, "b": still}, None, GTF).value == 1
