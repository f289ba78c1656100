"""Images that are left out or taken in: patterns, subfolders, formats."""

import cv2
import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.sequence import Selection, load_sequence
from tests.sequence import miniatures


@pytest.fixture
def photographs(tmp_path):
    miniatures.images(tmp_path, [f"IMG_{n}.png" for n in range(6)])
    return tmp_path


def _names(sequence):
    return [frame.path.name for frame in sequence.frames]


def test_a_pattern_leaves_out_one_odd_photograph(photographs):
    cv2.imwrite(str(photographs / "IMG_2.png"), cv2.resize(cv2.imread(str(photographs / "IMG_2.png")), (48, 64)))
    (photographs / "IMG_4.png").write_bytes(b"")

    with pytest.raises(SequenceError, match=r"IMG_4\.png: the image file is empty; .* leave it out with exclude"):
        load_sequence(photographs)
    sequence = load_sequence(photographs, selection=Selection(exclude=("IMG_2.*", "*_4.png")))

    assert _names(sequence) == ["IMG_0.png", "IMG_1.png", "IMG_3.png", "IMG_5.png"]
    assert [frame.frame_id for frame in sequence.frames] == [0, 1, 3, 5]


def test_patterns_act_before_the_other_steps(photographs):
    sequence = load_sequence(photographs, selection=Selection(exclude=("IMG_0.png",), stride=2, max_frames=2))

    assert _names(sequence) == ["IMG_1.png", "IMG_3.png"]


@pytest.mark.parametrize(("pattern", "message"), [("*.tif", "fits none of the 6 images"), ("*", "leaves no image")])
def test_a_pattern_that_changes_nothing_or_all_is_refused(photographs, pattern, message):
    with pytest.raises(SequenceError, match=message):
        load_sequence(photographs, selection=Selection(exclude=(pattern,)))


@pytest.mark.parametrize("layout", sorted(miniatures.LAYOUTS))
def test_patterns_work_on_every_layout_and_keep_poses_with_their_images(tmp_path, layout):
    miniatures.LAYOUTS[layout](tmp_path)
    whole = load_sequence(tmp_path)

    sequence = load_sequence(tmp_path, selection=Selection(exclude=(whole.frames[1].path.name,)))

    assert [frame.frame_id for frame in sequence.frames] == [0, 2, 3, 4]
    if whole.ground_truth:
        kept = whole.ground_truth.select([0, 2, 3, 4])
        assert sequence.ground_truth.positions.tolist() == kept.positions.tolist()


@pytest.fixture
def nested(tmp_path):
    miniatures.images(tmp_path, ["b/2.png", "b/10.png", "a/1.png", "a/deep/3.png", ".hidden/4.png", "__MACOSX/5.png"])
    return tmp_path


def test_images_in_subfolders_alone_are_named_with_the_way_out(nested):
    with pytest.raises(SequenceError, match=r"in subfolders: a/ \(1\), a/deep/ \(1\), b/ \(2\); .* recursive = true"):
        load_sequence(nested)


def test_subfolders_are_read_when_asked_for(nested):
    sequence = load_sequence(nested, selection=Selection(recursive=True))

    assert [frame.path.relative_to(nested).as_posix() for frame in sequence.frames] == [
        "a/1.png",
        "a/deep/3.png",
        "b/2.png",
        "b/10.png",
    ]
    assert sequence.notes == ()


def test_patterns_fit_paths_below_the_folder(nested):
    sequence = load_sequence(nested, selection=Selection(recursive=True, exclude=("b/*",)))

    assert _names(sequence) == ["1.png", "3.png"]


def test_images_in_subfolders_beside_others_are_noted(nested):
    miniatures.images(nested, ["0.png"])

    (note,) = load_sequence(nested).notes

    assert note.startswith("4 images in subfolders are left out: a/ (1), a/deep/ (1), b/ (2)")


def test_recursion_is_for_plain_folders(nested):
    with pytest.raises(SequenceError, match="recursive is for layout 'folder', not 'kitti'"):
        load_sequence(nested, layout="kitti", selection=Selection(recursive=True))


@pytest.mark.parametrize("suffix", [".CR2", ".nef", ".dng", ".jxl"])
def test_a_folder_of_raw_photographs_says_so(tmp_path, suffix):
    (tmp_path / f"a{suffix}").write_bytes(b"x")

    with pytest.raises(SequenceError, match=rf"formats that are not read: 1 \({suffix[1:].lower()}\); develop"):
        load_sequence(tmp_path)


def test_of_two_formats_of_one_photograph_the_classic_one_is_read(tmp_path):
    miniatures.images(tmp_path, ["a.jpg", "b.jpg", "a.webp", "c.webp"])

    assert _names(load_sequence(tmp_path)) == ["a.jpg", "b.jpg", "c.webp"]
    assert _names(load_sequence(tmp_path, selection=Selection(rules=1))) == ["a.jpg", "b.jpg"]
