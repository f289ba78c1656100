"""Turns of a camera are told from motion by homographies alone, with a known focal length and without."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gtf_tune.sequence import Camera
from gtf_tune.sequence.turning import turning_pairs

SIZE = (640, 480)
CENTRE = (319.5, 239.5)


def _homographies(focal, translation=(0.0, 0.0, 0.0), count=10, seed=0):
    """Return the homographies of turns of 3 to 12 degrees in front of a plane at distance 1, with noise."""
    rng = np.random.default_rng(seed)
    matrix = np.array([[focal, 0, CENTRE[0]], [0, focal, CENTRE[1]], [0, 0, 1]])
    found = []
    for angle in np.radians(np.linspace(3, 12, count)):
        axis = np.array([0.2 * rng.standard_normal(), 1.0, 0.2 * rng.standard_normal()])
        turn = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
        moved = turn + np.outer(translation, [0, 0, 1])
        homography = matrix @ moved @ np.linalg.inv(matrix)
        found.append(homography / homography[2, 2] * (1 + 1e-5 * rng.standard_normal((3, 3))))
    return found


@pytest.mark.parametrize("share", [0.5, 0.8, 1.2, 2.0])
def test_turns_are_found_at_any_focal_length(share):
    focal = share * SIZE[0]
    camera = Camera("PINHOLE", *SIZE, (focal, focal, 320, 240))

    assert all(turning_pairs(_homographies(focal), SIZE, camera))
    assert all(turning_pairs(_homographies(focal), SIZE, None))


@pytest.mark.parametrize("translation", [(0.1, 0, 0), (0, 0.05, 0.05), (0, 0, 0.1)])
def test_motion_in_front_of_a_plane_is_no_turn(translation):
    focal = 0.8 * SIZE[0]
    camera = Camera("PINHOLE", *SIZE, (focal, focal, 320, 240))

    assert not any(turning_pairs(_homographies(focal, translation), SIZE, camera))
    assert not any(turning_pairs(_homographies(focal, translation), SIZE, None))


def test_motion_along_a_plane_without_turns_is_none_at_an_unknown_focal_length():
    shifts = [np.array([[1.0, 0, 4.0 + n], [0, 1, 0], [0, 0, 1]]) for n in range(10)]

    assert not any(turning_pairs(shifts, SIZE, None))


def test_pairs_that_no_homography_explains_are_no_turns():
    turns = _homographies(500.0, count=4)

    assert turning_pairs([turns[0], None, turns[1], None], SIZE, None) == [True, False, True, False]
    assert turning_pairs([None, None], SIZE, None) == [False, False]
