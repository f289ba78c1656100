from dataclasses import replace

import numpy as np
import pytest

from gtf_tune.definition import GtfDefinition
from gtf_tune.study.runs.run_source import SequenceRuns
from gtf_tune.study.scoring.objective import CoverageFloor, coverage_floor, least_floor, score_sequence, score_trial
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
    assert coverage_floor([1.0, 0.98], [0.9, 0.8], 0.95) == CoverageFloor(pytest.approx(0.931), pytest.approx(0.76))


@pytest.mark.parametrize("bad", [0.0, 0.12])
def test_a_nominal_run_that_failed_or_lost_the_sequence_sets_no_example(bad: float) -> None:
    assert coverage_floor([1.0, 1.0], [0.9, bad, 0.9], 1.0) == CoverageFloor(1.0, 0.9)


def test_where_no_run_of_a_kind_worked_the_other_kind_counts() -> None:
    assert coverage_floor([0.0, 0.0], [0.8, 0.9], 1.0) == CoverageFloor(0.8, 0.8)


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
