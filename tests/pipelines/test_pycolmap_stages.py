"""A stage is built again exactly when something that it depends on has changed."""

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap
import pytest

from gtf_tune.errors import OptionError, RunError
from gtf_tune.pipelines import OptionValue, PipelineJob, create_pipeline
from gtf_tune.pipelines.analytic import imaginary_sequence
from gtf_tune.pipelines.colmap.database import copy_database
from gtf_tune.pipelines.colmap.stages import StagedRun
from gtf_tune.sequence import Camera, ImageSource, Sequence
from gtf_tune.testing import ContractCase, FolderStages

STAGES = ("features", "matches", "geometry", "calibration", "positioning")
NOWHERE = Path("nowhere")
Change = Mapping[str, Any]


@dataclass(frozen=True)
class _Keys:
    """Collect the keys that a run asks for, without building anything."""

    found: dict[str, str]

    def reach(self, stage: str, key: str, build: Callable[[Path], None]) -> Path:
        del build
        self.found[stage] = key
        return NOWHERE


def keys_of(
    options: Mapping[str, OptionValue] | None = None,
    settings: Mapping[str, object] | None = None,
    version: str = "",
    **job: Any,
) -> dict[str, str]:
    """Return the key of every stage of a glomap run on images of an unknown camera."""
    pipeline: Any = create_pipeline("glomap", settings or {})
    images = ImageSource(imaginary_sequence(5).with_camera(job.pop("camera", None)))
    values = {"images": images, "seed": 1, "threads": 1} | job
    full = PipelineJob(**values, options=pipeline.options.check(options or {}), workspace=NOWHERE, stages=_Keys({}))
    built = pipeline._tree.build(full.options, threads=full.threads, seed=full.seed)
    staged = StagedRun(full, built, pipeline.settings, version or pipeline.version)
    positioning: dict[str, str] = {}
    stages = _Keys(positioning)
    with pytest.raises(FileNotFoundError):  # there is no database to map
        pipeline.map(replace(staged, job=replace(full, stages=stages)))
    keys = {stage: getattr(staged, f"{stage}_key") for stage in STAGES[:-1]}
    return keys | {"positioning": positioning["positioning"]}


def changed(**change: Any) -> tuple[str, ...]:
    before, after = keys_of(), keys_of(**change)
    return tuple(stage for stage in STAGES if before[stage] != after[stage])


@pytest.mark.parametrize(
    ("option", "value", "first"),
    [
        ("extraction.sift.peak_threshold", 0.01, 0),
        ("matching.sift.max_ratio", 0.7, 1),
        ("exhaustive.block_size", 20, 1),
        ("verification.ransac.max_error", 2.0, 2),
        ("matching.guided_matching", True, 2),
        ("view_graph.max_calibration_error", 3.0, 3),
        ("mapper.rotation_averaging.max_rotation_error_deg", 5.0, 4),
        ("mapper.max_angular_reproj_error_deg", 2.0, 4),
        ("pipeline.min_num_matches", 20, 4),
        ("mapper.max_normalized_reproj_error", 0.001, 5),
        ("mapper.bundle_adjustment.ceres.loss_function_scale", 0.1, 5),
        ("mapper.retriangulation.min_angle", 2.0, 5),
    ],
)
def test_an_option_changes_its_own_stage_and_those_after_it(option: str, value: OptionValue, first: int) -> None:
    assert changed(options={option: value}) == STAGES[first:]


@pytest.mark.parametrize(
    ("change", "first"),
    [
        ({"images": ImageSource(imaginary_sequence(5), sigma=1.0)}, 0),
        ({"camera": Camera("PINHOLE", 64, 48, (50.0, 50.0, 32.0, 24.0))}, 0),
        ({"settings": {"camera_model": "OPENCV"}}, 0),
        ({"version": "9.9"}, 0),
        ({"threads": 2}, 0),
        ({"settings": {"pairing": "sequential"}}, 1),
        ({"seed": 2}, 2),
    ],
)
def test_everything_else_that_matters_is_in_the_keys(change: Change, first: int) -> None:
    assert changed(**change) == STAGES[first:]


def test_explicit_defaults_have_the_keys_of_absent_options() -> None:
    defaults = {name: spec.default for name, spec in create_pipeline("glomap").options.specs.items()}

    assert changed(options=defaults) == ()


def test_glomap_and_colmap_share_their_first_stages(scene: Sequence, kept_stages: FolderStages, tmp_path: Path) -> None:
    ContractCase(create_pipeline("glomap"), scene).run(tmp_path / "1", kept_stages)
    built = list(kept_stages.built)
    ContractCase(create_pipeline("colmap"), scene).run(tmp_path / "2", kept_stages)

    assert {"images", "features", "matches", "geometry", "positioning"} <= {stage for stage, _ in built}
    assert kept_stages.built == built


def test_images_of_a_noisy_copy_are_not_kept(scene: Sequence, tmp_path: Path) -> None:
    case, stages = ContractCase(create_pipeline("glomap"), scene), FolderStages(tmp_path / "stages")
    stages.folder.mkdir()
    job = replace(case.job(tmp_path / "run", stages, {}), images=ImageSource(scene, sigma=2.0))

    case.pipeline.run(job)

    kept = {path.suffix for path in stages.folder.rglob("*") if path.is_file()}
    assert {"features", "matches"} <= {stage for stage, _ in stages.built}
    assert ".pgm" not in kept
    assert not list((tmp_path / "run").rglob("*.pgm"))


def test_stages_hold_what_the_next_one_needs_and_no_more(
    scene: Sequence, kept_stages: FolderStages, tmp_path: Path
) -> None:
    ContractCase(create_pipeline("glomap"), scene).run(tmp_path / "run", kept_stages)

    size = {path.parent.name.split("-")[0]: path.stat().st_size for path in kept_stages.folder.glob("*/database.db")}
    assert size["matches"] < size["features"] / 4
    assert size["geometry"] < size["features"] / 2
    assert {path.name for path in kept_stages.folder.glob("*/*.db*")} == {"database.db"}


def test_guided_matching_adds_to_the_same_first_matches(
    scene: Sequence, kept_stages: FolderStages, tmp_path: Path
) -> None:
    case = ContractCase(create_pipeline("glomap"), scene)
    plain = case.run(tmp_path / "1", kept_stages)
    built = list(kept_stages.built)

    guided = case.run(tmp_path / "2", kept_stages, {"matching.guided_matching": True})

    assert [stage for stage, _ in kept_stages.built[len(built) :]] == ["geometry", "positioning"]
    assert guided.diagnostics["num_points3D"] > plain.diagnostics["num_points3D"]


def test_sequential_pairing_matches_neighbours_only(scene: Sequence, kept_stages: FolderStages, tmp_path: Path) -> None:
    pipeline = create_pipeline("glomap", {"pairing": "sequential"})
    options = {"sequential.overlap": 2, "sequential.quadratic_overlap": False}
    before = len(kept_stages.built)

    output = ContractCase(pipeline, scene, options).run(tmp_path / "run", kept_stages)

    key = dict(kept_stages.built[before:])["geometry"]
    copy_database(kept_stages.folder / f"geometry-{key}" / "database.db", tmp_path / "geometry.db")
    database = pycolmap.Database.open(tmp_path / "geometry.db")
    assert database.num_verified_image_pairs() == 2 * len(scene) - 3
    assert len(output.trajectory) == len(scene)
    database.close()


def test_loop_detection_asks_for_a_vocabulary_tree() -> None:
    options = create_pipeline("glomap", {"pairing": "sequential"}).options

    with pytest.raises(OptionError, match=r"needs a vocabulary tree file; .*'vocab_tree_path'"):
        options.check({"sequential.loop_detection": True})


def vocabulary_tree(features: Path, tree: Path) -> Path:
    """Build a small vocabulary tree from the descriptors of a database."""
    copy_database(features, tree.with_suffix(".db"))
    database = pycolmap.Database.open(tree.with_suffix(".db"))
    described = [database.read_descriptors(image.image_id) for image in database.read_all_images()]
    database.close()
    words = np.vstack([one.data for one in described]).astype(np.float32)
    options = pycolmap.VisualIndex.BuildOptions()
    options.num_visual_words, options.num_threads = 32, 1
    index = pycolmap.VisualIndex.create(words.shape[1], 64)
    index.build(options, pycolmap.FeatureDescriptorsFloat(described[0].type, words))
    index.write(tree)
    return tree


def test_loop_detection_matches_more_than_neighbours(
    scene: Sequence, kept_stages: FolderStages, tmp_path: Path
) -> None:
    options = {"sequential.overlap": 1, "sequential.quadratic_overlap": False}
    ContractCase(create_pipeline("glomap"), scene).run(tmp_path / "features", kept_stages)
    features = next(key for stage, key in kept_stages.built if stage == "features")
    tree = vocabulary_tree(kept_stages.folder / f"features-{features}" / "database.db", tmp_path / "tree.bin")
    pipeline = create_pipeline("glomap", {"pairing": "sequential", "vocab_tree_path": str(tree)})
    loops = {"sequential.loop_detection": True, "sequential.loop_detection_period": 1}
    before = len(kept_stages.built)

    output = ContractCase(pipeline, scene, options).run(tmp_path / "run", kept_stages, loops)

    key = dict(kept_stages.built[before:])["geometry"]
    copy_database(kept_stages.folder / f"geometry-{key}" / "database.db", tmp_path / "geometry.db")
    database = pycolmap.Database.open(tmp_path / "geometry.db")
    assert database.num_verified_image_pairs() > len(scene) - 1
    assert len(output.trajectory) == len(scene)
    database.close()


def test_the_vocabulary_tree_is_part_of_the_matches(tmp_path: Path) -> None:
    for name in ("a", "b"):
        (tmp_path / name).write_bytes(struct.pack("<iii", 2, 128, 64) + name.encode())
    settings = [{"pairing": "sequential", "vocab_tree_path": str(tmp_path / name)} for name in ("a", "b")]
    loops = {"sequential.loop_detection": True}

    with_loops = [keys_of(options=loops, settings=one)["matches"] for one in settings]
    without = [keys_of(settings=one)["matches"] for one in settings]

    assert with_loops[0] != with_loops[1]
    assert without[0] == without[1]


def test_a_failure_inside_colmap_names_its_stage(scene: Sequence, kept_stages: FolderStages, tmp_path: Path) -> None:
    case = ContractCase(create_pipeline("glomap"), scene, {"mapper.skip_rotation_averaging": True})

    with pytest.raises(RunError, match="COLMAP stopped in stage 'positioning'"):
        case.run(tmp_path, kept_stages)
