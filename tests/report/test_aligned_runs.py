import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from gtf_tune.metrics import ate
from gtf_tune.report.aligned_runs import ConfigurationRuns, align_runs, in_one_frame
from gtf_tune.report.panels.frames import frame_spread
from gtf_tune.trajectory import Trajectory

FRAMES = 12


def walk(seed: int = 0, noise: float = 0.0, frames: int = FRAMES) -> Trajectory:
    generator = np.random.default_rng(seed)
    angle = np.linspace(0, 4, frames)
    positions = np.stack([3 * np.cos(angle), 2 * np.sin(angle), 0.3 * np.sin(5 * angle)], axis=1)
    return Trajectory(
        frame_ids=np.arange(frames),
        timestamps=np.arange(frames) / 30,
        positions=positions + noise * generator.standard_normal(positions.shape),
        quaternions=np.tile([0.0, 0.0, 0.0, 1.0], (frames, 1)),
    )


def setting(clean: list[Trajectory], noisy: list[Trajectory]) -> ConfigurationRuns:
    return ConfigurationRuns("nominal", tuple(clean), tuple(noisy), FRAMES)


@given(scale=st.floats(0.1, 10), seed=st.integers(0, 1000))
def test_a_run_in_another_world_frame_lies_exactly_on_the_first(scale: float, seed: int) -> None:
    rotation = Rotation.random(random_state=seed).as_matrix()
    other = walk().transformed(scale, rotation, np.array([1.0, -2.0, 3.0]))

    first, second = align_runs(setting([walk()], [other]))

    assert np.allclose(first.positions, second.positions, atol=1e-9)
    assert np.allclose(second.errors, 0, atol=1e-6)


def test_errors_of_a_noisy_run_add_up_to_its_ate() -> None:
    clean, noisy = walk(), walk(seed=1, noise=0.05)
    extent = float(np.sqrt(((clean.positions - clean.positions.mean(axis=0)) ** 2).sum(axis=1).mean()))

    run = align_runs(setting([clean], [noisy]))[1]

    assert np.sqrt((run.errors**2).mean()) == pytest.approx(1000 * ate(clean, noisy) / extent)


def test_positions_are_seen_along_the_direction_of_least_motion() -> None:
    run = align_runs(setting([walk()], []))[0]

    spread = np.ptp(run.positions, axis=0)

    assert spread[0] >= spread[1] >= spread[2]


def test_the_only_clean_run_has_nothing_to_be_compared_with() -> None:
    assert np.isnan(align_runs(setting([walk()], []))[0].errors).all()


def test_failed_runs_are_left_out() -> None:
    runs = align_runs(setting([Trajectory.empty(), walk()], [Trajectory.empty(), walk(seed=1, noise=0.01)]))

    assert [(run.kind, run.index) for run in runs] == [("clean", 1), ("noisy", 1)]


def test_a_setting_without_a_clean_run_cannot_be_drawn() -> None:
    assert align_runs(setting([Trajectory.empty()], [walk()])) == ()


def test_thinning_keeps_the_ends_of_a_run() -> None:
    run = align_runs(setting([walk(frames=100)], []))[0]

    thinned = run.thinned(10)

    assert len(thinned.frame_ids) == 10
    assert (thinned.frame_ids[0], thinned.frame_ids[-1]) == (0, 99)


def test_settings_are_drawn_in_one_world_frame() -> None:
    moved = walk().transformed(2.0, Rotation.from_euler("z", 1.0).as_matrix(), np.array([5.0, 0.0, 0.0]))

    first, second = in_one_frame([setting([walk()], []), setting([moved], [])])

    assert np.allclose(first.clean[0].positions, second.clean[0].positions)


def test_a_frame_that_jumps_in_every_noisy_run_is_fragile() -> None:
    clean = [walk(frames=60), walk(seed=1, noise=0.001, frames=60)]
    noisy = []
    for seed in (2, 3, 4):
        run = walk(seed=seed, noise=0.002, frames=60)
        positions = run.positions.copy()
        positions[5] += [0.0, 0.0, 0.5]
        noisy.append(Trajectory(run.frame_ids, run.timestamps, positions, run.quaternions))

    spread = frame_spread(setting(clean, noisy))

    assert np.flatnonzero(spread.fragile).tolist() == [5]
    assert spread.median[5] > 50


def test_a_frame_missing_from_some_runs_is_counted() -> None:
    cut = walk(seed=1, noise=0.01).select(np.arange(FRAMES) != 3)

    spread = frame_spread(setting([walk()], [cut]))

    assert spread.registered[3] == 0.5
    assert np.isnan(spread.median[3])
    assert (np.delete(spread.registered, 3) == 1).all()


def test_a_setting_whose_runs_all_failed_has_no_frames_to_speak_of() -> None:
    nothing = Trajectory.empty()

    for failed in (setting([nothing, nothing], []), setting([nothing], [nothing, nothing])):
        spread = frame_spread(failed)

        assert spread.frame_ids.size == spread.median.size == spread.registered.size == spread.fragile.size == 0
