import pickle

import cv2
import numpy as np
import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Camera, Selection, layout_help, layout_names, load_sequence, pinhole_from_opencv


def test_frames_come_in_natural_order(tmp_path, write_images):
    write_images(tmp_path, ["img10.png", "img9.png", "img1.jpg", ".hidden.png"])
    (tmp_path / "notes.txt").write_text("not an image")

    sequence = load_sequence(tmp_path)

    assert [frame.path.name for frame in sequence.frames] == ["img1.jpg", "img9.png", "img10.png"]
    assert [frame.frame_id for frame in sequence.frames] == [0, 1, 2]
    assert (sequence.layout, sequence.name, len(sequence)) == ("folder", tmp_path.name, 3)
    assert (sequence.width, sequence.height) == (64, 48)
    assert sequence.camera is None
    assert sequence.ground_truth is None


def test_photographs_in_a_format_that_is_not_read_are_noted(tmp_path, write_images):
    write_images(tmp_path, ["img1.jpg", "img3.jpg"])
    for name in ("img1.cr2", "img2.CR2", "img4.jxl"):
        (tmp_path / name).write_bytes(b"x")

    (note,) = load_sequence(tmp_path).notes

    assert "not read: 2 (cr2, jxl)" in note


def test_frame_ids_are_positions_before_the_selection(tmp_path, write_images):
    write_images(tmp_path, [f"{n}.png" for n in range(10)])

    sequence = load_sequence(tmp_path, selection=Selection(start=2, stride=3, max_frames=2))

    assert [frame.frame_id for frame in sequence.frames] == [2, 5]


def test_images_and_intrinsics_shrink_together(tmp_path, write_images):
    write_images(tmp_path, ["0.png", "1.png"])
    camera = pinhole_from_opencv((50, 50), (31.5, 23.5), (64, 48))

    sequence = load_sequence(tmp_path, selection=Selection(max_image_size=32), camera=camera)

    assert sequence.read_grey(sequence.frames[0]).shape == (24, 32)
    assert sequence.camera == Camera("PINHOLE", 32, 24, (25, 25, 16, 12))
    assert sequence.stored_size == (64, 48)


def test_intrinsics_of_another_resolution_are_fitted(tmp_path, write_images):
    write_images(tmp_path, ["0.png", "1.png"])

    sequence = load_sequence(tmp_path, camera=Camera("SIMPLE_PINHOLE", 640, 480, (500, 320, 240)))

    assert sequence.camera == Camera("SIMPLE_PINHOLE", 64, 48, (50, 32, 24))


def test_a_name_can_be_given(tmp_path, write_images):
    write_images(tmp_path, ["0.png"])

    assert load_sequence(tmp_path, name="mine").name == "mine"


def test_images_of_different_sizes_are_not_those_of_one_camera(tmp_path, write_images):
    write_images(tmp_path, ["0.png", "1.png"])
    cv2.imwrite(str(tmp_path / "2.png"), np.zeros((48, 65), np.uint8))

    assert load_sequence(tmp_path).taken_by == (0, 0, 1)
    with pytest.raises(SequenceError, match=r"2\.png: expected 64x48 pixels like 0\.png, not 65x48"):
        load_sequence(tmp_path, selection=Selection(cameras="one"))


def test_an_empty_image_is_refused_at_once_and_a_damaged_one_when_read(tmp_path, write_images):
    paths = write_images(tmp_path, ["0.png", "1.png"])
    damaged = bytearray(paths[1].read_bytes())
    damaged[len(damaged) // 2] ^= 0x55
    paths[1].write_bytes(damaged)

    with pytest.raises(SequenceError, match=r"1\.png: cannot be decoded"):
        _ = load_sequence(tmp_path).fingerprint
    paths[1].write_bytes(b"")
    with pytest.raises(SequenceError, match=r"1\.png: the image file is empty"):
        load_sequence(tmp_path)


def test_an_image_that_changes_its_size_after_loading_is_refused(tmp_path, write_images):
    write_images(tmp_path, ["0.png", "1.png"])
    sequence = load_sequence(tmp_path)
    write_images(tmp_path, ["0.png"], width=32, height=32)

    with pytest.raises(SequenceError, match=r"0\.png: expected 64x48"):
        sequence.read_grey(sequence.frames[0])


def test_a_folder_without_images_is_refused(tmp_path):
    with pytest.raises(SequenceError, match=r"found neither images \(avif, .*\) nor a known layout"):
        load_sequence(tmp_path)
    with pytest.raises(SequenceError, match="found no images"):
        load_sequence(tmp_path, layout="folder")
    with pytest.raises(SequenceError, match="there is no such file or folder"):
        load_sequence(tmp_path / "nowhere")


def test_a_selection_that_leaves_nothing_is_refused(tmp_path, write_images):
    write_images(tmp_path, ["0.png"])

    with pytest.raises(SequenceError, match="leaves none of the 1 images"):
        load_sequence(tmp_path, selection=Selection(start=7))


def test_work_on_a_sequence_asks_for_enough_frames(tmp_path, write_images):
    write_images(tmp_path, [f"{number}.png" for number in range(3)])

    assert len(load_sequence(tmp_path, fewest=3)) == 3
    with pytest.raises(SequenceError, match="expected at least 4 frames, not 3; add more images"):
        load_sequence(tmp_path, fewest=4)
    with pytest.raises(SequenceError, match="leaves 1 of the 3 frames, at least 2 are needed; change start"):
        load_sequence(tmp_path, selection=Selection(stride=3), fewest=2)


def test_a_rate_needs_timestamps(tmp_path, write_images):
    write_images(tmp_path, ["0.png"])

    with pytest.raises(SequenceError, match="rate_hz needs timestamps"):
        load_sequence(tmp_path, selection=Selection(rate_hz=3.0))


def test_a_file_in_the_place_of_a_folder_is_refused(tmp_path):
    (tmp_path / "file").write_text("")

    for name in layout_names():
        with pytest.raises(SequenceError):
            load_sequence(tmp_path / "file", layout=name)


def test_an_unknown_layout_is_refused_with_the_nearest_name(tmp_path):
    with pytest.raises(SequenceError, match="unknown layout 'tumrgbd'; did you mean 'tum-rgbd'"):
        load_sequence(tmp_path, layout="tumrgbd")


def test_every_layout_says_where_to_get_its_data():
    assert set(layout_help()) == set(layout_names())
    assert all(len(text) > 40 for text in layout_help().values())


def test_fingerprint_follows_pixels_frame_ids_and_size(tmp_path, write_images):
    write_images(tmp_path, [f"{n}.png" for n in range(4)])
    base = load_sequence(tmp_path).fingerprint

    others = {
        load_sequence(tmp_path, selection=selection).fingerprint
        for selection in (Selection(stop=3), Selection(start=1), Selection(max_image_size=32))
    }
    cv2.imwrite(str(tmp_path / "3.png"), np.zeros((48, 64), np.uint8))
    others.add(load_sequence(tmp_path).fingerprint)

    assert len(others | {base}) == 5


def test_fingerprint_does_not_depend_on_the_file_format(tmp_path, write_images):
    write_images(tmp_path / "png", ["0.png", "1.png"])
    write_images(tmp_path / "bmp", ["x0.bmp", "x1.bmp"])

    assert load_sequence(tmp_path / "png").fingerprint == load_sequence(tmp_path / "bmp").fingerprint


def test_fingerprint_is_computed_once_even_across_processes(tmp_path, write_images):
    paths = write_images(tmp_path, ["0.png"])
    sequence = load_sequence(tmp_path)
    before = sequence.fingerprint
    paths[0].unlink()

    assert sequence.fingerprint == before
    assert pickle.loads(pickle.dumps(sequence)).fingerprint == before


def test_depth_maps_and_masks_among_photographs_are_noted(tmp_path, write_images):
    write_images(tmp_path, ["a_0.png", "a_1.png", "a_0_depth.png", "a_1_mask_0001.png", "unmasked.png"])

    (note,) = load_sequence(tmp_path).notes

    assert note == "2 images are called like depth maps or masks, such as a_0_depth.png: leave them out with exclude"
    assert load_sequence(tmp_path, selection=Selection(exclude=("*_depth*", "*_mask*"))).notes == ()
