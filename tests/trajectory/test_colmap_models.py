import struct
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gtf_tune.errors import TrajectoryError
from gtf_tune.trajectory import Trajectory, read_trajectory

IMAGE = "1 1 0 0 0 1 2 3 1 a.png\n"


@pytest.fixture(scope="module")
def model() -> pycolmap.Reconstruction:
    options = pycolmap.SyntheticDatasetOptions()
    options.num_rigs, options.num_cameras_per_rig, options.num_frames_per_rig, options.num_points3D = 1, 2, 6, 20
    return pycolmap.synthesize_dataset(options)


@pytest.fixture(scope="module")
def folders(model, tmp_path_factory) -> dict[str, Path]:
    root = tmp_path_factory.mktemp("models")
    for name, write in (("binary", model.write), ("text", model.write_text)):
        (root / name).mkdir()
        write(root / name)
    return {name: root / name for name in ("binary", "text")}


def named(folder: Path, *names: str) -> Trajectory:
    (folder / "images.txt").write_text("".join(f"1 1 0 0 0 {i} 0 0 1 {name}\n\n" for i, name in enumerate(names)))
    return read_trajectory(folder)


@pytest.mark.parametrize("kind", ["binary", "text"])
def test_poses_are_those_that_pycolmap_wrote(model, folders, kind):
    found = read_trajectory(folders[kind])

    assert sorted(found.names) == sorted(image.name for image in model.images.values())
    images = {image.name: image for image in model.images.values()}
    for name, position, turn in zip(found.names, found.positions, found.rotations, strict=True):
        image = images[name]
        np.testing.assert_allclose(position, image.projection_center(), atol=1e-12)
        np.testing.assert_allclose(turn.as_matrix().T, image.cam_from_world().rotation.matrix(), atol=1e-12)


def test_text_and_binary_models_are_the_same(folders):
    text, binary = read_trajectory(folders["text"]), read_trajectory(folders["binary"])

    assert text.names == binary.names
    np.testing.assert_allclose(text.positions, binary.positions, rtol=1e-14, atol=1e-14)


def test_images_files_can_be_named_themselves(folders):
    for kind, name in (("text", "images.txt"), ("binary", "images.bin")):
        for format in ("auto", "colmap"):
            assert len(read_trajectory(folders[kind] / name, format)) == 12


def test_images_that_are_not_registered_have_no_pose(model, tmp_path):
    part = pycolmap.Reconstruction(model)
    part.deregister_frame(next(iter(part.reg_frame_ids())))
    part.write(tmp_path)

    assert len(read_trajectory(tmp_path)) == len(model.images) - 2


def test_names_that_are_numbers_become_frame_ids(tmp_path):
    found = named(tmp_path, "000012.png", "000003.png", "000100.png")

    assert found.frame_ids.tolist() == [3, 12, 100]
    assert found.timestamps.tolist() == [3, 12, 100]
    assert found.names == ("000003.png", "000012.png", "000100.png")
    assert found.positions[:, 0].tolist() == [-1, 0, -2]


def test_other_names_are_counted_in_natural_order(tmp_path):
    found = named(tmp_path, "img10.png", "img9.png", "img010.png", "a/7.png", "a/" + "9" * 5000)

    assert found.frame_ids.tolist() == [0, 1, 2, 3, 4]
    assert found.names[:2] == ("a/7.png", "a/" + "9" * 5000)
    assert found.names[2:] == ("img9.png", "img010.png", "img10.png")


def test_the_same_numbers_in_two_folders_are_counted(tmp_path):
    assert named(tmp_path, "left/1.png", "left/2.png", "right/1.png").frame_ids.tolist() == [0, 1, 2]


def test_names_may_hold_spaces(tmp_path):
    assert named(tmp_path, "my photo 1.png").names == ("my photo 1.png",)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("# nothing\n", "at least one registered image in"),
        ("1 1 0 0 0 1 2 3 1\n\n", "line 1: expected 'IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME', not 9 columns"),
        ("1 1 0 0 x 1 2 3 1 a.png\n\n", "line 1: .*'x'"),
        ("1 1 0 0 0 1 nan 3 1 a.png\n\n", "line 1: .* NaN or infinite"),
        ("1 1 1 1 1 1 2 3 1 a.png\n\n", "line 1: expected a unit quaternion, but its length is 2"),
        (IMAGE + "\n" + IMAGE, "one name comes twice"),
        (IMAGE + IMAGE, "line 2: expected the image's points"),
        (IMAGE + "1 2 3 4\n", "line 2: expected the image's points"),
        (IMAGE + "1.5 2.5 a.png\n", "line 2: expected the image's points"),
    ],
)
def test_malformed_text_is_refused_with_file_and_line(tmp_path, text, reason):
    (tmp_path / "images.txt").write_text(text)

    with pytest.raises(TrajectoryError, match=reason) as caught:
        read_trajectory(tmp_path)

    assert str(tmp_path) in str(caught.value)


def test_a_folder_without_a_model_says_what_is_missing(tmp_path):
    with pytest.raises(TrajectoryError, match="COLMAP model with images"):
        read_trajectory(tmp_path)


def test_every_cut_of_a_binary_model_is_refused(folders, tmp_path):
    data = (folders["binary"] / "images.bin").read_bytes()
    file = tmp_path / "images.bin"

    for length in {0, 4, 8, 20, 72, 80, 110, len(data) // 2, len(data) - 1}:
        file.write_bytes(data[:length])
        with pytest.raises(TrajectoryError, match=r"images\.bin"):
            read_trajectory(file)
    file.write_bytes(data + b"\0")
    with pytest.raises(TrajectoryError, match="of another format"):
        read_trajectory(file)


def binary_image(quaternion=(1.0, 0, 0, 0), position=(0.0, 0, 0), name=b"a.png\0", points=0) -> bytes:
    pose = struct.pack("<I7dI", 1, *quaternion, *position, 1)
    return struct.pack("<Q", 1) + pose + name + struct.pack("<Q", points)


@pytest.mark.parametrize(
    ("data", "reason"),
    [
        (binary_image(quaternion=(2.0, 0, 0, 0)), "image 1 of 1: expected a unit quaternion"),
        (binary_image(position=(np.nan, 0, 0)), "image 1 of 1: expected finite numbers"),
        (binary_image(name=b"\xff\0"), "image 1 of 1: expected an image name in UTF-8"),
        (binary_image(points=2**63), "it is cut short"),
        (struct.pack("<Q", 2**64 - 1), "image 1 of 18446744073709551615: expected more"),
        (struct.pack("<Q", 0), "at least one registered image"),
        (binary_image()[:72] + b"a.png", "ends in a zero byte"),
    ],
)
def test_malformed_binaries_are_refused_with_the_image(tmp_path, data, reason):
    (tmp_path / "images.bin").write_bytes(data)

    with pytest.raises(TrajectoryError, match=reason):
        read_trajectory(tmp_path)


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(
    content=st.one_of(
        st.binary(max_size=300),
        st.binary(max_size=200).map(lambda tail: struct.pack("<Q", 1) + tail),
        st.binary(max_size=60).map(lambda tail: binary_image()[:-8] + tail),
        st.text(max_size=40).map(lambda tail: (IMAGE + tail).encode("utf-8", "surrogatepass")),
    )
)
def test_any_bytes_are_read_or_refused(tmp_path, content):
    for name in ("images.bin", "images.txt"):
        file = tmp_path / name
        file.write_bytes(content)
        try:
            trajectory = read_trajectory(file, "colmap")
        except TrajectoryError:
            continue
        assert len(trajectory) > 0


def test_the_folder_of_a_project_says_where_its_models_are(tmp_path):
    for name in ("10", "2"):
        (tmp_path / "sparse" / name).mkdir(parents=True)
        (tmp_path / "sparse" / name / "images.txt").write_text("")

    with pytest.raises(TrajectoryError, match=r"but there is none; give one of sparse/2, sparse/10$"):
        read_trajectory(tmp_path, "colmap")
