import pickle

import cv2
import numpy as np
import pytest

from gtf_tune.errors import MachineError, SequenceError
from gtf_tune.sequence import ImageSource, Selection, load_sequence


@pytest.fixture
def sequence(tmp_path, write_images):
    write_images(tmp_path / "images", [f"{n}.png" for n in range(6)])
    return load_sequence(tmp_path / "images", selection=Selection(stride=2))


def _written(source, folder, threads=1):
    folder.mkdir()
    source.write(folder, threads=threads)
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_files_are_named_by_frame_id(sequence, tmp_path):
    source = ImageSource(sequence, sigma=3.0, seed=1)

    files = _written(source, tmp_path / "out")

    assert sorted(files) == list(source.names) == ["000000.pgm", "000002.pgm", "000004.pgm"]
    assert [source.frame_id_of(name) for name in source.names] == [0, 2, 4]
    assert source.frame_id_of("some/folder/000004.pgm") == 4


def test_unknown_names_are_refused(sequence):
    with pytest.raises(SequenceError, match=r"'000001\.pgm' is not an image of sequence 'images'"):
        ImageSource(sequence).frame_id_of("000001.pgm")


def test_clean_files_hold_the_pixels_of_the_sequence(sequence, tmp_path):
    _written(ImageSource(sequence), tmp_path / "out")

    for frame in sequence.frames:
        written = cv2.imread(str(tmp_path / "out" / f"{frame.frame_id:06d}.pgm"), cv2.IMREAD_UNCHANGED)
        np.testing.assert_array_equal(written, sequence.read_grey(frame))


def test_noisy_files_differ_from_clean_ones_by_the_noise_alone(sequence, tmp_path):
    clean = _written(ImageSource(sequence), tmp_path / "clean")
    noisy = _written(ImageSource(sequence, sigma=4.0, seed=9), tmp_path / "noisy")

    assert {name: len(data) for name, data in clean.items()} == {name: len(data) for name, data in noisy.items()}
    read = [cv2.imread(str(tmp_path / kind / "000002.pgm"), -1).astype(int) for kind in ("clean", "noisy")]
    inside = (read[0] > 20) & (read[0] < 235)
    assert np.std((read[1] - read[0])[inside]) == pytest.approx(4.0, rel=0.1)


def test_threads_do_not_change_the_files(sequence, tmp_path):
    source = ImageSource(sequence, sigma=4.0, seed=9)

    assert _written(source, tmp_path / "one") == _written(source, tmp_path / "four", threads=4)


def test_noise_of_a_frame_does_not_depend_on_the_selection(sequence, tmp_path):
    whole = load_sequence(sequence.root)

    some = _written(ImageSource(sequence, sigma=4.0, seed=9), tmp_path / "some")
    all_of_them = _written(ImageSource(whole, sigma=4.0, seed=9), tmp_path / "all")

    assert some.items() <= all_of_them.items()


def test_key_follows_sigma_seed_and_pixels(sequence):
    keys = {
        ImageSource(one, sigma=sigma, seed=seed).key
        for one in (sequence, load_sequence(sequence.root))
        for sigma, seed in [(0.0, 0), (3.0, 0), (3.0, 1), (3.1, 1)]
    }

    assert len(keys) == 8
    assert all(len(key) == 64 and int(key, 16) >= 0 for key in keys)


def test_clean_images_have_one_key_whatever_the_seed(sequence):
    assert ImageSource(sequence, seed=1).key == ImageSource(sequence, seed=2).key


def test_a_source_travels_to_another_process(sequence):
    source = ImageSource(sequence, sigma=2.0, seed=5)

    assert pickle.loads(pickle.dumps(source)).key == source.key


def test_a_folder_that_cannot_be_written_to_is_named(sequence, tmp_path):
    with pytest.raises(MachineError, match=r"000000\.pgm: cannot write the image \(No such file"):
        ImageSource(sequence).write(tmp_path / "missing")


@pytest.mark.parametrize(("sigma", "seed"), [(-1.0, 0), (float("nan"), 0), (1.0, -1)])
def test_impossible_noise_is_refused(sequence, sigma, seed):
    with pytest.raises(SequenceError, match="noise"):
        ImageSource(sequence, sigma=sigma, seed=seed)
