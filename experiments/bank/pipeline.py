"""GLOMAP that also describes its model by what a trajectory does not say."""

import contextlib
import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pycolmap

from gtf_tune.pipelines.base import DiagnosticValue, PipelineJob, PipelineOutput
from gtf_tune.pipelines.colmap.family import pycolmap_version, settings_of
from gtf_tune.pipelines.colmap.glomap import GlomapPipeline
from gtf_tune.pipelines.colmap.stages import StagedRun
from gtf_tune.trajectory import FloatArray


@dataclass
class BankPipeline(GlomapPipeline):
    """GLOMAP with more diagnostics; the runs themselves are those of `glomap`.

    Seconds of stages are processor time, as other programs share the machine.
    """

    measured: dict[str, DiagnosticValue] = field(default_factory=dict)

    def run(self, job: PipelineJob) -> PipelineOutput:
        output = super().run(job)
        return replace(output, diagnostics={**output.diagnostics, **self.measured})

    def map(self, staged: StagedRun) -> list[Any]:
        staged.clock.now = time.process_time
        began = time.process_time()
        models = super().map(staged)
        cpu_s = time.process_time() - began
        self.measured = {"cpu_s": cpu_s, "mapping_s": cpu_s - sum(staged.clock.seconds.values())}
        with contextlib.suppress(Exception):  # what is measured beside a run must not make it fail
            model = max(models, key=lambda found: found.num_reg_images())
            with staged.opened(staged.geometry()) as database:
                self.measured |= epipolar_errors(model, database)
            self.measured["covariance"] = predicted_deviation(model)
        return models


def create() -> BankPipeline:
    return BankPipeline("glomap", pycolmap_version(), settings_of("glomap", {}))


def epipolar_errors(model: Any, database: Any) -> dict[str, DiagnosticValue]:
    """Return medians in pixels of the Sampson error of verified matches: of all, and of those that no track holds."""
    rays = {image.image_id: _rays(model, image, database) for image in _registered(model)}
    tracks = {image.image_id: np.array([point.point3D_id for point in image.points2D]) for image in _registered(model)}
    poses = {image.image_id: image.cam_from_world() for image in _registered(model)}
    everything, unused = [np.empty(0)], [np.empty(0)]
    for pair, geometry in zip(*database.read_two_view_geometries(), strict=True):
        first, second = pycolmap.pair_id_to_image_pair(pair)
        matches = np.asarray(geometry.inlier_matches)
        if first not in poses or second not in poses or not len(matches):
            continue
        errors = _sampson(
            poses[second] * poses[first].inverse(), rays[first][matches[:, 0]], rays[second][matches[:, 1]]
        )
        held = tracks[first][matches[:, 0]]
        everything.append(errors)
        unused.append(errors[(held != tracks[second][matches[:, 1]]) | (held == pycolmap.INVALID_POINT3D_ID)])
    focal = next(iter(model.cameras.values())).mean_focal_length()
    medians = {"epipolar_px": np.concatenate(everything), "epipolar_unused_px": np.concatenate(unused)}
    return {name: float(focal * np.median(errors)) if len(errors) else -1.0 for name, errors in medians.items()}


def _registered(model: Any) -> list[Any]:
    return [model.images[image_id] for image_id in model.reg_image_ids()]


def _rays(model: Any, image: Any, database: Any) -> FloatArray:
    """Return the keypoints of an image on the plane at depth 1, (n, 3)."""
    points = np.asarray(database.read_keypoints(image.image_id), dtype=np.float64)[:, :2]
    plane = np.asarray(model.cameras[image.camera_id].cam_from_img(points))
    return np.column_stack([plane, np.ones(len(plane))])


def _sampson(second_from_first: Any, first: FloatArray, second: FloatArray) -> FloatArray:
    x, y, z = second_from_first.translation
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    essential = cross @ second_from_first.rotation.matrix()
    lines, back = first @ essential.T, second @ essential
    residuals = np.abs((second * lines).sum(axis=1))
    found: FloatArray = residuals / np.sqrt(
        np.maximum((lines[:, :2] ** 2).sum(axis=1) + (back[:, :2] ** 2).sum(axis=1), 1e-30)
    )
    return found


def predicted_deviation(model: Any) -> float:
    """Return the root mean variance of camera positions by the adjustment's covariance, as a share of the extent.

    Observations count with their own variance and without a robust loss, the gauge is fixed by two cameras; -1 where
    it cannot be computed.
    """
    options = pycolmap.BundleAdjustmentOptions()
    options.refine_focal_length = options.refine_principal_point = options.refine_extra_params = False
    options.print_summary = False
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    adjuster = pycolmap.create_default_ceres_bundle_adjuster(options, config, model)
    wanted = pycolmap.BACovarianceOptions(params=pycolmap.BACovarianceOptionsParams.POSES)
    found = pycolmap.estimate_ba_covariance(wanted, model, adjuster)
    if found is None:
        return -1.0
    variances = []
    for image in _registered(model):
        covariance = found.get_cam_cov_from_world(image.image_id)
        if covariance is not None and covariance.shape == (6, 6):
            variances.append(_position_variance(image.cam_from_world(), covariance))
    centres = np.array([image.projection_center() for image in _registered(model)])
    extent = float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean()))
    if not variances or extent == 0:
        return -1.0
    return float(np.sqrt(np.mean(variances)) * _residual_deviation(model) / extent)


def _position_variance(cam_from_world: Any, covariance: FloatArray) -> float:
    """Return the trace of the covariance of -R^T t, where the rotation is perturbed from the left."""
    rotation, (x, y, z) = cam_from_world.rotation.matrix(), cam_from_world.translation
    cross = np.array(((0.0, -z, y), (z, 0.0, -x), (-y, x, 0.0)))
    jacobian = np.hstack([-rotation.T @ cross, -rotation.T])
    return float(np.trace(jacobian @ covariance @ jacobian.T))


def _residual_deviation(model: Any) -> float:
    """Return the deviation of one coordinate of an observation in pixels, from reprojection errors of points."""
    points = list(model.points3D.values())
    squares = sum(len(point.track.elements) * point.error**2 for point in points)
    observations = sum(len(point.track.elements) for point in points)
    freedom = max(2 * observations - 3 * len(points) - 6 * model.num_reg_images() + 7, 1)
    return float(np.sqrt(squares / freedom))
