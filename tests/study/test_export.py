import csv
import io

from gtf_tune.study.outcome.export import colmap_flags, colmap_ini, table_csv


def test_flags_of_the_hierarchical_pipeline_go_to_its_own_command() -> None:
    options = {
        "clustering.leaf_max_num_images": 100,
        "hierarchical.init_num_trials": 5,
        "mapper.init_min_tri_angle": 8.0,
    }
    assert colmap_flags("colmap-hierarchical", options) == (
        "colmap feature_extractor --ImageReader.single_camera 1\ncolmap exhaustive_matcher\n"
        "colmap hierarchical_mapper --HierarchicalMapper.leaf_max_num_images 100 "
        "--HierarchicalMapper.init_num_trials 5 --Mapper.init_min_tri_angle 8.0\n"
    )


def test_a_project_file_has_only_comments_that_colmap_knows() -> None:
    text = colmap_ini("glomap", {"matching.sift.max_ratio": 0.7, "verification.min_inlier_ratio": 0.3})

    assert [line for line in text.splitlines() if not line.startswith("#")] == [
        *("[ImageReader]", "single_camera=1"),
        *("[SiftMatching]", "max_ratio=0.7"),
    ]


def test_a_project_file_says_above_its_sections_that_paths_belong_there() -> None:
    text = colmap_ini("glomap", {"matching.sift.max_ratio": 0.7})

    assert "database_path=" in text.partition("[")[0]


def test_commands_come_in_running_order_and_see_the_images_as_the_pipeline_does() -> None:
    options = {
        "sequential.loop_detection": True,
        "mapper.min_tri_angle_deg": 2.0,
        "view_graph.max_calibration_error": 1.0,
        "view_graph.loss_function_scale": 0.1,
    }
    settings = {"pairing": "sequential", "camera_model": "OPENCV", "vocab_tree_path": "/my trees/a.bin"}

    assert colmap_flags("glomap", options, settings).splitlines() == [
        "colmap feature_extractor --ImageReader.single_camera 1 --ImageReader.camera_model OPENCV",
        "colmap sequential_matcher --SequentialMatching.vocab_tree_path '/my trees/a.bin' "
        "--SequentialMatching.loop_detection 1",
        "colmap view_graph_calibrator --max_calibration_error 1.0  # only where the intrinsics are unknown",
        "colmap global_mapper --GlobalMapper.min_tri_angle_deg 2.0",
        "# only from pycolmap: view_graph.loss_function_scale=0.1",
    ]


def test_what_has_no_section_comes_first_in_a_project_file() -> None:
    text = colmap_ini("glomap", {"matching.sift.max_ratio": 0.7, "view_graph.relpose_max_error": 2.0})

    assert text.splitlines()[1:] == [
        *("relpose_max_error=2.0", "[ImageReader]", "single_camera=1"),
        *("[SiftMatching]", "max_ratio=0.7"),
    ]


def test_a_cell_that_a_spreadsheet_would_compute_is_a_text_in_csv_and_numbers_stay_numbers() -> None:
    rows = [['=HYPERLINK("x")', "+1+1", "@cmd", "-x", -0.5, "-1.5e-3", "-", None, "cmd = 1"]]

    written = list(csv.reader(io.StringIO(table_csv(["a"] * 9, rows))))[1]

    assert written == ['\'=HYPERLINK("x")', "'+1+1", "'@cmd", "'-x", "-0.5", "-1.5e-3", "-", "", "cmd = 1"]
