"""What the bank measures beside a run, on a synthetic model whose right answers are known."""

import numpy as np
import pycolmap
import pytest

from experiments.bank.pipeline import epipolar_errors, predicted_deviation


def _model(folder, noise_px):
    """Return a model adjusted to observations with noise in pixels, the true model, and the database of matches."""
    options = pycolmap.SyntheticDatasetOptions(
        num_rigs=1, num_frames_per_rig=8, num_points3D=150, camera_model_id=pycolmap.CameraModelId.PINHOLE
    )
    options.camera_params = [1280.0, 1280.0, 512.0, 384.0]
    pycolmap.set_random_seed(0)
    database = pycolmap.Database.open(folder / f"{noise_px}.db")
    model = pycolmap.synthesize_dataset(options, database)
    truth = pycolmap.Reconstruction(model)
    pycolmap.synthesize_noise(pycolmap.SyntheticNoiseOptions(point2D_stddev=noise_px), model, database)
    adjusted = pycolmap.BundleAdjustmentOptions(refine_focal_length=False, refine_extra_params=False)
    adjusted.print_summary = False
    pycolmap.bundle_adjustment(model, adjusted)
    model.update_point_3d_errors()
    return model, truth, database


def _relative_error(model, truth):
    found, wanted = (
        np.array([reconstruction.images[number].projection_center() for number in sorted(reconstruction.images)])
        for reconstruction in (model, truth)
    )
    found, wanted = found - found.mean(axis=0), wanted - wanted.mean(axis=0)
    similarity = pycolmap.estimate_sim3d(found, wanted)
    aligned = np.array([similarity * point for point in found])
    return float(np.linalg.norm(aligned - wanted) / np.linalg.norm(wanted))


def test_epipolar_errors_are_those_of_the_noise_and_vanish_without_it(tmp_path):
    exact, noisy = (
        epipolar_errors(model, database) for model, _, database in (_model(tmp_path, 0), _model(tmp_path, 1))
    )

    assert exact["epipolar_px"] == pytest.approx(0, abs=1e-4)
    assert 0.3 < noisy["epipolar_px"] < 1.2
    assert noisy["epipolar_unused_px"] == -1


def test_the_predicted_deviation_follows_the_noise_and_is_near_the_true_error(tmp_path):
    (weak, _, _), (strong, truth, _) = _model(tmp_path, 0.5), _model(tmp_path, 1)

    assert predicted_deviation(strong) == pytest.approx(2 * predicted_deviation(weak), rel=0.3)
    assert 0.3 < _relative_error(strong, truth) / predicted_deviation(strong) < 3
