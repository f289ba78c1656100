"""Colour images: read as they are stored, noise in each channel, keys of their own."""

import cv2
import numpy as np
import pytest

from gtf_tune.errors import SequenceError
from gtf_tune.pipelines.command import create
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import ImageSource, load_sequence
from gtf_tune.sequence.images import read_colour

COLOUR = (10, 100, 200)
SIZE = (48, 64)


def folder_of(path, pixels):
    path.mkdir()
    for number in range(2):
        assert cv2.imwrite(str(path / f"{number}.png"), pixels)
    return load_sequence(path)


@pytest.fixture
def coloured(tmp_path):
    return folder_of(tmp_path / "colour", np.full((*SIZE, 3), COLOUR, np.uint8))


@pytest.mark.parametrize(
    ("stored", "expected"),
    [
        (np.full((2, 2, 3), COLOUR, np.uint8), COLOUR),
        (np.full((2, 2, 4), (*COLOUR, 0), np.uint8), COLOUR),
        (np.full((2, 2), 70, np.uint8), (70, 70, 70)),
        (np.full((2, 2, 3), np.array(COLOUR) * 257, np.uint16), COLOUR),
    ],
)
def test_every_kind_of_image_has_three_channels_in_colour(tmp_path, stored, expected):
    cv2.imwrite(str(tmp_path / "a.png"), stored)

    np.testing.assert_array_equal(read_colour(tmp_path / "a.png"), np.full((2, 2, 3), expected))


def test_each_channel_has_noise_of_its_own(coloured):
    source = ImageSource(coloured, sigma=4.0, seed=1, channels=3)

    noise = source.read(coloured.frames[0]).astype(float) - COLOUR
    again = source.read(coloured.frames[0]).astype(float) - COLOUR

    np.testing.assert_array_equal(noise, again)
    np.testing.assert_allclose(noise.std(axis=(0, 1)), 4.0, rtol=0.1)
    assert np.abs(np.corrcoef(noise.reshape(-1, 3).T) - np.eye(3)).max() < 0.1


def test_images_that_are_equal_in_grey_have_other_keys_in_colour_alone(coloured, tmp_path):
    grey = folder_of(tmp_path / "grey", coloured.read_grey(coloured.frames[0]))

    assert ImageSource(coloured).key == ImageSource(grey).key
    assert ImageSource(coloured, channels=3).key != ImageSource(grey, channels=3).key
    assert ImageSource(coloured, channels=3).key != ImageSource(coloured).key


def test_another_colour_of_the_same_grey_is_a_change(coloured):
    assert coloured.colour_fingerprint
    grey = coloured.read_grey(coloured.frames[0])
    cv2.imwrite(str(coloured.frames[0].path), cv2.merge([grey] * 3))

    with pytest.raises(SequenceError, match="were changed while they were worked on"):
        coloured.check_unchanged()


def test_a_definition_asks_for_colour(coloured):
    words = {"arguments": ["python3", "{images}"], "output": {"path": "poses.txt"}}

    pipeline = create(words | {"images": {"channels": 3, "name": "{index}.png"}})
    request = RunRequest(pipeline, {}, coloured, "clean", 0, 0.0, 0, 0)

    assert request.images.read(coloured.frames[0])[0, 0].tolist() == list(COLOUR)
    assert request.key != RunRequest(create(words), {}, coloured, "clean", 0, 0.0, 0, 0).key


def test_a_grey_definition_has_the_identity_that_it_had_before_colour():
    words = {"arguments": ["python3", "{images}"], "output": {"path": "poses.txt"}}

    assert create(words).settings["identity"] == "f978a7468db4665bcda04e2bfad342bb05b879fc87865747cdebaa77156026ba"
