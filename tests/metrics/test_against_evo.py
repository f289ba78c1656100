import os
from pathlib import Path

import numpy as np
import pytest
from evo.core import metrics
from evo.core.trajectory import PoseTrajectory3D
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtf_tune.metrics import RpeSettings, aligned_errors, ate, pairwise_matrix, rpe, rpe_errors
from gtf_tune.trajectory import Trajectory

SEEDS = st.integers(0, 2**32 - 1)
ALIGNMENTS = ["sim3", "se3", "none"]
RELATIONS = {
    "translation": metrics.PoseRelation.translation_part,
    "rotation": metrics.PoseRelation.rotation_angle_deg,
}
UNITS = {"frames": metrics.Unit.frames, "metres": metrics.Unit.meters}


def walk(seed: int, count: int) -> Trajectory:
    rng = np.random.default_rng(seed)
    turns = Rotation.from_rotvec(0.1 * rng.normal(size=(count, 3)).cumsum(axis=0))
    return Trajectory(
        np.arange(count), np.arange(count) / 30, rng.normal(size=(count, 3)).cumsum(axis=0), turns.as_quat()
    )


def disturbed(trajectory: Trajectory, seed: int, noise: float = 0.05, scale: float = 3.0) -> Trajectory:
    rng = np.random.default_rng(seed)
    size = np.sqrt(trajectory.positions.var(axis=0).sum())
    turns = Rotation.from_rotvec(noise * rng.normal(size=(len(trajectory), 3)))
    noisy = Trajectory(
        trajectory.frame_ids,
        trajectory.timestamps,
        trajectory.positions + noise * size * rng.normal(size=trajectory.positions.shape),
        (turns * trajectory.rotations).as_quat(),
    )
    frame = Rotation.random(random_state=rng).as_matrix()
    return noisy.transformed(scale, frame, size * rng.normal(size=3))


def evo_trajectories(a: Trajectory, b: Trajectory, alignment: str) -> tuple[PoseTrajectory3D, PoseTrajectory3D]:
    first, second = (
        PoseTrajectory3D(one.positions.copy(), np.roll(one.quaternions, 1, axis=1), one.timestamps.copy())
        for one in (a, b)
    )
    if alignment != "none":
        second.align(first, correct_scale=alignment == "sim3")
    return first, second


def evo_ate(a: Trajectory, b: Trajectory, alignment: str) -> metrics.APE:
    metric = metrics.APE(metrics.PoseRelation.translation_part)
    metric.process_data(evo_trajectories(a, b, alignment))
    return metric


def evo_rpe(a: Trajectory, b: Trajectory, chosen: RpeSettings) -> metrics.RPE:
    metric = metrics.RPE(
        RELATIONS[chosen.relation],
        delta=chosen.delta,
        delta_unit=UNITS[chosen.delta_unit],
        all_pairs=chosen.pairs == "all",
    )
    metric.process_data(evo_trajectories(a, b, chosen.alignment))
    return metric


@pytest.mark.parametrize("alignment", ALIGNMENTS)
@settings(deadline=None, max_examples=15)
@given(seed=SEEDS, count=st.integers(4, 80))
def test_ate_is_that_of_evo(alignment, seed, count):
    a = walk(seed, count)
    b = disturbed(a, seed + 1)

    expected = evo_ate(a, b, alignment)

    assert ate(a, b, alignment) == pytest.approx(expected.get_statistic(metrics.StatisticsType.rmse), rel=1e-9)
    np.testing.assert_allclose(aligned_errors(a, b, alignment), expected.error, rtol=1e-9)


@pytest.mark.parametrize("alignment", ALIGNMENTS)
@pytest.mark.parametrize("relation", ["translation", "rotation"])
@pytest.mark.parametrize("pairs", ["all", "consecutive"])
@pytest.mark.parametrize(("delta_unit", "delta"), [("frames", 1), ("frames", 7), ("metres", 2.5)])
def test_rpe_is_that_of_evo(alignment, relation, pairs, delta_unit, delta):
    a = walk(5, 150)
    b = disturbed(a, 6, scale=1.3)
    chosen = RpeSettings(relation, delta, delta_unit, pairs, alignment)

    expected = evo_rpe(a, b, chosen)

    np.testing.assert_allclose(rpe_errors(a, b, chosen), expected.error, rtol=1e-9, atol=1e-12)
    assert rpe(a, b, chosen) == pytest.approx(expected.get_statistic(metrics.StatisticsType.rmse), rel=1e-9)


@settings(deadline=None, max_examples=20)
@given(seed=SEEDS, count=st.integers(30, 60), delta=st.floats(0.5, 4.0), pairs=st.sampled_from(["all", "consecutive"]))
def test_pairs_along_the_path_are_those_of_evo(seed, count, delta, pairs):
    a = walk(seed, count)
    b = disturbed(a, seed + 1, noise=0.01)
    chosen = RpeSettings("translation", delta, "metres", pairs)

    try:
        expected = evo_rpe(a, b, chosen).error
    except metrics.filters.FilterException:
        expected = np.empty(0)

    np.testing.assert_allclose(rpe_errors(a, b, chosen), expected, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("alignment", ALIGNMENTS)
def test_the_matrix_of_real_trajectories_is_that_of_evo(alignment):
    data = os.environ.get("GTF_TUNE_DATA")
    if not data or not (files := sorted(Path(data).glob("*/groundtruth.txt"))):
        pytest.skip("GTF_TUNE_DATA does not name a folder with */groundtruth.txt")
    for file in files:
        rows = np.loadtxt(file)
        a = Trajectory(np.arange(len(rows)), rows[:, 0], rows[:, 1:4], rows[:, 4:])
        noisy = [disturbed(a, seed, noise=10.0**-seed) for seed in range(1, 6)]

        found = pairwise_matrix([a], noisy, RpeSettings(delta=3, alignment=alignment)).errors[0]
        aligned = [ate(a, b, alignment) for b in noisy]

        expected = [evo_ate(a, b, alignment).get_statistic(metrics.StatisticsType.rmse) for b in noisy]
        np.testing.assert_allclose(aligned, expected, rtol=1e-9, err_msg=str(file))
        chosen = RpeSettings(delta=3, alignment=alignment)
        expected = [evo_rpe(a, b, chosen).get_statistic(metrics.StatisticsType.rmse) for b in noisy]
        np.testing.assert_allclose(found, expected, rtol=1e-9, err_msg=str(file))
