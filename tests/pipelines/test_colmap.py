"""COLMAP's incremental and hierarchical mappers keep the pipeline contract and find the cameras."""

from pathlib import Path

import pytest

from gtf_tune.errors import RunError
from gtf_tune.metrics import ate
from gtf_tune.pipelines import create_pipeline
from gtf_tune.sequence import Sequence
from gtf_tune.testing import ContractCase, FolderStages, PipelineContract

KNOWN_INTRINSICS = {"pipeline.ba_refine_focal_length": False, "pipeline.ba_refine_extra_params": False}
SMALL_MODELS = {"pipeline.min_model_size": 3}
QUICK = {"extraction.sift.first_octave": 0}


class TestColmapContract(PipelineContract):
    @pytest.fixture(scope="class")
    @classmethod
    def case(cls, scene: Sequence) -> ContractCase:
        return ContractCase(create_pipeline("colmap"), scene, KNOWN_INTRINSICS | SMALL_MODELS | QUICK)


@pytest.mark.parametrize("name", ["colmap", "colmap-hierarchical"])
def test_colmap_finds_every_camera(scene: Sequence, kept_stages: FolderStages, tmp_path: Path, name: str) -> None:
    case = ContractCase(create_pipeline(name), scene, KNOWN_INTRINSICS | SMALL_MODELS)

    output = case.run(tmp_path, kept_stages)

    assert scene.ground_truth is not None
    assert len(output.trajectory) == len(scene)
    assert ate(scene.ground_truth, output.trajectory) < 0.01
    assert output.diagnostics["num_registered"] == len(scene)


def test_small_clusters_are_merged(scene: Sequence, kept_stages: FolderStages, tmp_path: Path) -> None:
    options = {"clustering.leaf_max_num_images": 6, "clustering.image_overlap": 4}
    case = ContractCase(create_pipeline("colmap-hierarchical"), scene, KNOWN_INTRINSICS | SMALL_MODELS | options)

    output = case.run(tmp_path, kept_stages)

    assert len(output.trajectory) == len(scene)


def test_no_initial_pair_is_a_failed_run(scene: Sequence, kept_stages: FolderStages, tmp_path: Path) -> None:
    case = ContractCase(create_pipeline("colmap"), scene, {"mapper.init_min_tri_angle": 170.0})

    with pytest.raises(RunError, match=r"no model in 9 images with \d+ features, \d+ verified pairs"):
        case.run(tmp_path, kept_stages)
