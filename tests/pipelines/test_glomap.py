"""GLOMAP keeps the pipeline contract, finds the cameras and equals the uninterrupted mapper."""

from pathlib import Path
from typing import Any

import pycolmap
import pytest

from gtf_tune.errors import RunError
from gtf_tune.metrics import ate
from gtf_tune.pipelines import PipelineOutput, create_pipeline
from gtf_tune.pipelines.colmap.database import copy_database
from gtf_tune.pipelines.colmap.family import run_to_models, trajectory_of
from gtf_tune.pipelines.colmap.stages import DATABASE, StagedRun
from gtf_tune.sequence import Sequence
from gtf_tune.testing import ContractCase, FolderStages, PipelineContract
from gtf_tune.trajectory import to_bytes

KNOWN_INTRINSICS = {
    "mapper.bundle_adjustment.refine_focal_length": False,
    "mapper.bundle_adjustment.refine_extra_params": False,
}
QUICK = {"extraction.sift.first_octave": 0}


class TestGlomapContract(PipelineContract):
    @pytest.fixture(scope="class")
    @classmethod
    def case(cls, scene: Sequence) -> ContractCase:
        return ContractCase(create_pipeline("glomap"), scene, KNOWN_INTRINSICS | QUICK)


@pytest.fixture(scope="module")
def nominal(scene: Sequence, kept_stages: FolderStages, tmp_path_factory: pytest.TempPathFactory) -> PipelineOutput:
    case = ContractCase(create_pipeline("glomap"), scene, KNOWN_INTRINSICS)
    return case.run(tmp_path_factory.mktemp("nominal"), kept_stages)


def test_glomap_finds_every_camera(scene: Sequence, nominal: PipelineOutput) -> None:
    assert scene.ground_truth is not None
    assert nominal.trajectory.frame_ids.tolist() == scene.ground_truth.frame_ids.tolist()
    assert ate(scene.ground_truth, nominal.trajectory) < 0.01


def test_rotations_point_the_way_of_the_ground_truth(scene: Sequence, nominal: PipelineOutput) -> None:
    assert scene.ground_truth is not None
    true, found = scene.ground_truth.rotations, nominal.trajectory.rotations

    relative = (true[0].inv() * true[-1]) * (found[0].inv() * found[-1]).inv()

    assert relative.magnitude() < 0.01


def test_diagnostics_describe_the_model(nominal: PipelineOutput, scene: Sequence) -> None:
    assert nominal.diagnostics["num_models"] == 1
    assert nominal.diagnostics["num_registered"] == len(scene)
    assert nominal.diagnostics["num_points3D"] > 200
    assert 0 < nominal.diagnostics["mean_reprojection_error_px"] < 1
    assert nominal.diagnostics["mean_track_length"] > 2
    assert nominal.diagnostics["mapping_s"] > 0


def test_cached_stages_are_named(
    scene: Sequence, kept_stages: FolderStages, nominal: PipelineOutput, tmp_path: Path
) -> None:
    del nominal
    case = ContractCase(create_pipeline("glomap"), scene, KNOWN_INTRINSICS)

    again = case.run(tmp_path, kept_stages, {"verification.ransac.max_error": 3.3})

    cached = {name: value for name, value in again.diagnostics.items() if name.endswith("_cached")}
    assert cached == {
        "images_cached": True,
        "features_cached": True,
        "matches_cached": True,
        "geometry_cached": False,
        "positioning_cached": False,
    }


@pytest.mark.parametrize("threshold", [0.01, 0.001])
def test_split_mapping_equals_the_uninterrupted_mapper_to_the_bit(
    scene: Sequence, kept_stages: FolderStages, tmp_path: Path, threshold: float
) -> None:
    pipeline: Any = create_pipeline("glomap")
    case = ContractCase(pipeline, scene, KNOWN_INTRINSICS | {"mapper.max_normalized_reproj_error": threshold})

    split = case.run(tmp_path / "split", kept_stages)

    job = case.job(tmp_path / "whole", kept_stages, {})
    options = pipeline._tree.build(job.options, threads=1, seed=job.seed)
    staged = StagedRun(job, options, pipeline.settings, pipeline.version)
    with staged.opened(staged.geometry()) as database:
        (model,) = run_to_models(lambda manager: pycolmap.GlobalPipeline(options["mapping"], database, manager))
    assert to_bytes(split.trajectory) == to_bytes(trajectory_of(model, job.images))


def test_unknown_intrinsics_are_calibrated_first(scene: Sequence, kept_stages: FolderStages, tmp_path: Path) -> None:
    case = ContractCase(create_pipeline("glomap"), scene.with_camera(None))

    output = case.run(tmp_path, kept_stages)

    assert "calibration" in [stage for stage, _ in kept_stages.built]
    assert output.diagnostics["calibration_cached"] is False
    assert len(output.trajectory) == len(scene)


def test_unknown_intrinsics_give_what_colmap_gives_in_one_go(
    scene: Sequence, kept_stages: FolderStages, tmp_path: Path
) -> None:
    pipeline: Any = create_pipeline("glomap")
    case = ContractCase(pipeline, scene.with_camera(None))
    output = case.run(tmp_path / "staged", kept_stages)

    job = case.job(tmp_path / "whole", kept_stages, {})
    options = pipeline._tree.build(job.options, threads=1, seed=job.seed)
    staged = StagedRun(job, options, pipeline.settings, pipeline.version)
    matches = tmp_path / "whole.db"
    copy_database(kept_stages.folder / f"features-{staged.features_key}" / DATABASE, matches)
    pycolmap.match_exhaustive(
        matches, options["matching"], options["pairing"], options["verification"], pycolmap.Device.cpu
    )
    pycolmap.calibrate_view_graph(matches, options["view_graph"])
    database = pycolmap.Database.open(matches)
    (model,) = run_to_models(lambda manager: pycolmap.GlobalPipeline(options["mapping"], database, manager))
    database.close()
    assert to_bytes(output.trajectory) == to_bytes(trajectory_of(model, job.images))


def test_seeds_change_two_view_geometry_only(
    scene: Sequence, kept_stages: FolderStages, nominal: PipelineOutput, tmp_path: Path
) -> None:
    case = ContractCase(create_pipeline("glomap"), scene, KNOWN_INTRINSICS, seed=8)

    other = case.run(tmp_path, kept_stages)

    assert other.diagnostics["matches_cached"] is True
    assert other.diagnostics["geometry_cached"] is False
    assert to_bytes(other.trajectory) != to_bytes(nominal.trajectory)


def test_no_model_is_a_failed_run_with_numbers(scene: Sequence, kept_stages: FolderStages, tmp_path: Path) -> None:
    case = ContractCase(create_pipeline("glomap"), scene, {"verification.min_num_inliers": 100_000})

    with pytest.raises(RunError, match=r"no model in 9 images with \d+ features, 0 verified pairs"):
        case.run(tmp_path, kept_stages)


def test_workspaces_are_left_empty(scene: Sequence, kept_stages: FolderStages, tmp_path: Path) -> None:
    ContractCase(create_pipeline("glomap"), scene, KNOWN_INTRINSICS).run(tmp_path, kept_stages)

    assert list((tmp_path / "workspace").iterdir()) == []
