from gtf_tune.study.export import colmap_flags, colmap_ini


def test_flags_of_the_hierarchical_pipeline_go_to_its_own_command() -> None:
    options = {
        "clustering.leaf_max_num_images": 100,
        "hierarchical.init_num_trials": 5,
        "mapper.init_min_tri_angle": 8.0,
    }
    assert colmap_flags("colmap-hierarchical", options) == (
        "colmap hierarchical_mapper --HierarchicalMapper.leaf_max_num_images 100 "
        "--HierarchicalMapper.init_num_trials 5 --Mapper.init_min_tri_angle 8.0\n"
    )


def test_a_project_file_has_only_comments_that_colmap_knows() -> None:
    text = colmap_ini("glomap", {"matching.sift.max_ratio": 0.7, "verification.min_inlier_ratio": 0.3})

    assert [line for line in text.splitlines() if not line.startswith("#")] == ["[SiftMatching]", "max_ratio=0.7"]


def test_a_project_file_says_above_its_sections_that_paths_belong_there() -> None:
    text = colmap_ini("glomap", {"matching.sift.max_ratio": 0.7})

    assert "database_path=" in text.partition("[")[0]
