from gtf_tune.study.export import colmap_flags


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
