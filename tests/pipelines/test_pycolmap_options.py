"""The option tree is what pycolmap's own objects say."""

import copy
from collections.abc import Mapping
from typing import Any

import pycolmap
import pytest

from gtf_tune.errors import OptionError
from gtf_tune.pipelines import OptionSpec, OptionTable, create_pipeline
from gtf_tune.pipelines.colmap.options import OptionRoot, OptionTree, read_tree

EXTRACTION = {"extraction": OptionRoot("FeatureExtractionOptions", "features", {(): "extraction"})}
GLOMAP = {"mapping": OptionRoot("GlobalPipelineOptions", "mapping", {(): "pipeline", ("mapper",): "mapper"})}
COLMAP = {
    "mapping": OptionRoot(
        "IncrementalPipelineOptions",
        "mapping",
        {(): "pipeline", ("mapper",): "mapper", ("triangulation",): "triangulation"},
    )
}


@pytest.fixture(scope="module")
def table() -> OptionTable:
    return create_pipeline("glomap").options


def specs_of(roots: Mapping[str, OptionRoot]) -> Mapping[str, OptionSpec]:
    return read_tree(roots).table("p", lambda _: None).specs


@pytest.mark.parametrize(
    ("name", "default", "stage"),
    [
        ("extraction.sift.peak_threshold", pycolmap.SiftExtractionOptions().peak_threshold, "features"),
        ("matching.sift.max_ratio", pycolmap.SiftMatchingOptions().max_ratio, "matches"),
        ("exhaustive.block_size", pycolmap.ExhaustivePairingOptions().block_size, "matches"),
        ("verification.ransac.max_error", pycolmap.TwoViewGeometryOptions().ransac.max_error, "geometry"),
        (
            "view_graph.max_calibration_error",
            pycolmap.ViewGraphCalibrationOptions().max_calibration_error,
            "calibration",
        ),
        ("mapper.max_normalized_reproj_error", pycolmap.GlobalMapperOptions().max_normalized_reproj_error, "mapping"),
        ("mapper.bundle_adjustment.ceres.loss_function_scale", 1.0, "mapping"),
        ("mapper.rotation_averaging.max_rotation_error_deg", 10.0, "mapping"),
        ("pipeline.min_num_matches", pycolmap.GlobalPipelineOptions().min_num_matches, "mapping"),
    ],
)
def test_the_options_of_the_paper_are_there(table: OptionTable, name: str, default: float, stage: str) -> None:
    assert table.specs[name].default == default
    assert table.specs[name].stage == stage


def test_documentation_is_that_of_pycolmap_without_the_default_or_ours_where_it_has_none(table: OptionTable) -> None:
    assert table.specs["extraction.sift.edge_threshold"].documentation == "Edge threshold for detection."
    assert table.specs["mapper.max_normalized_reproj_error"].documentation.startswith("Observations with a larger")
    assert not any("default:" in spec.documentation for spec in table.specs.values())


def test_enumerations_are_words(table: OptionTable) -> None:
    spec = table.specs["mapper.bundle_adjustment.ceres.loss_function_type"]

    assert spec.default == "HUBER"
    assert set(spec.choices) == set(pycolmap.LossFunctionType.__members__)


def test_what_the_run_decides_is_no_option(table: OptionTable) -> None:
    words = {word for name in table.specs for word in name.replace(".", "_").split("_")}

    assert words.isdisjoint({"threads", "seed", "gpu", "path", "names", "workers"})


def test_every_number_and_truth_value_of_a_class_is_an_option() -> None:
    names = {name.removeprefix("extraction.sift.") for name in specs_of(EXTRACTION) if ".sift." in name}

    assert names == set(pycolmap.SiftExtractionOptions().todict())


def test_fields_that_their_owner_overwrites_are_no_options() -> None:
    names = specs_of(COLMAP)

    assert "mapper.init_max_error" in names
    assert "pipeline.min_focal_length_ratio" in names
    assert "mapper.min_focal_length_ratio" not in names
    assert "triangulation.min_focal_length_ratio" not in names


def test_hierarchical_mapping_has_the_options_of_incremental_mapping() -> None:
    inner = set(create_pipeline("colmap").options.specs)
    names = set(create_pipeline("colmap-hierarchical").options.specs)

    assert inner < names
    assert {"clustering.leaf_max_num_images", "hierarchical.init_num_trials"} < names


def test_values_reach_the_objects() -> None:
    values = {
        "mapper.max_normalized_reproj_error": 0.5,
        "mapper.bundle_adjustment.ceres.loss_function_type": "CAUCHY",
        "pipeline.min_num_matches": 20,
    }

    options = read_tree(GLOMAP).build(values, threads=1, seed=0)["mapping"]

    assert options.mapper.max_normalized_reproj_error == 0.5
    assert options.mapper.bundle_adjustment.ceres.loss_function_type == pycolmap.LossFunctionType.CAUCHY
    assert options.min_num_matches == 20


def test_objects_are_never_shared() -> None:
    tree = read_tree(GLOMAP)

    tree.build({"mapper.max_normalized_reproj_error": 0.5}, threads=1, seed=0)

    assert tree.build({}, threads=1, seed=0)["mapping"].mapper.max_normalized_reproj_error == 0.01


def test_explicit_defaults_are_the_same_values() -> None:
    tree = read_tree(GLOMAP)
    defaults = {name: leaf.spec.default for name, leaf in tree.leaves.items()}

    assert tree.build(defaults, threads=1, seed=0).values == tree.build({}, threads=1, seed=0).values


def leaves_of(one: Any, prefix: str = "") -> dict[str, Any]:
    found = {}
    for name, value in one.todict(recursive=False).items():
        found |= leaves_of(value, f"{prefix}{name}.") if hasattr(value, "todict") else {prefix + name: value}
    return found


def test_threads_seed_and_cpu_are_set_everywhere() -> None:
    fields = leaves_of(read_tree(GLOMAP).build({}, threads=3, seed=11)["mapping"])

    assert {value for name, value in fields.items() if name.endswith("num_threads")} == {3}
    assert {value for name, value in fields.items() if name.endswith("random_seed")} == {11}
    assert {value for name, value in fields.items() if name.endswith("use_gpu")} == {False}


def test_an_inner_loop_keeps_its_one_thread() -> None:
    roots = {"verification": OptionRoot("TwoViewGeometryOptions", "geometry", {(): "verification"})}

    ransac = read_tree(roots).build({}, threads=4, seed=11)["verification"].ransac

    assert (ransac.num_threads, ransac.random_seed) == (1, 11)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("extraction.sift.peak_threshold", -1.0),
        ("matching.sift.max_ratio", -0.5),
        ("exhaustive.block_size", 0),
        ("verification.ransac.max_error", -4.0),
        ("mapper.bundle_adjustment.ceres.loss_function_scale", -1.0),
        ("mapper.bundle_adjustment.ceres.solver_options.eta", -0.1),
    ],
)
def test_what_pycolmap_refuses_is_an_error_before_anything_runs(
    table: OptionTable, name: str, value: float, capfd: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(OptionError, match=f"pycolmap .* refuses '{name}' = {value}"):
        table.check({name: value})

    assert capfd.readouterr().err == ""


def test_numbers_too_large_for_the_field_are_refused(table: OptionTable) -> None:
    with pytest.raises(OptionError, match=r"'mapper\.ba_num_iterations' cannot hold 1099511627776"):
        table.check({"mapper.ba_num_iterations": 2**40})


def test_checking_leaves_the_log_level_alone(table: OptionTable) -> None:
    before = copy.copy(pycolmap.logging.minloglevel)

    table.check({})

    assert pycolmap.logging.minloglevel == before


def test_unknown_options_come_with_the_nearest_names(table: OptionTable) -> None:
    with pytest.raises(OptionError, match=r"did you mean 'mapper\.max_normalized_reproj_error'"):
        table.check({"mapper.max_normalised_reproj_err": 0.01})


def test_trees_are_read_from_the_objects_alone() -> None:
    tree = read_tree(GLOMAP)

    assert isinstance(tree, OptionTree)
    assert len(tree.leaves) > 100


def test_the_version_is_that_of_the_module_that_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pycolmap, "__version__", "9.9.9")  # as pycolmap-cuda12 beside or in place of pycolmap

    assert create_pipeline("glomap").version == "9.9.9"
