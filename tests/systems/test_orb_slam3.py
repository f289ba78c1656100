"""ORB-SLAM3 itself runs by its example; `make test-systems` installs it, without it there is nothing to test."""

import subprocess
from pathlib import Path

import pytest

from gtf_tune.metrics import ate
from gtf_tune.sequence import RoomSpec, Sequence, load_sequence, render_room
from tests.systems.conftest import SYSTEMS, RunSystem, python_of

FRAMES = 90


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a rendered walk, with the vocabulary that is trained on it beside it."""
    python, folder = python_of("orb_slam3"), tmp_path_factory.mktemp("orb") / "room"
    render_room(folder, RoomSpec(num_frames=FRAMES, seed=5))
    trainer = SYSTEMS / "orb_slam3" / "train_vocabulary.py"
    train = [str(python), str(trainer), str(folder.with_name("words.txt")), str(folder)]
    subprocess.run(train, check=True, capture_output=True)
    return folder


@pytest.fixture(scope="module")
def room(folder: Path) -> Sequence:
    return load_sequence(folder)


@pytest.mark.parametrize("features", [400, 1000])
def test_orb_slam3_tracks_a_rendered_walk(run_system: RunSystem, room: Sequence, folder: Path, features: int) -> None:
    words = str(folder.with_name("words.txt"))
    outcome = run_system("orb_slam3", room, {"ORBextractor.nFeatures": features}, vocabulary=words)

    assert outcome.status == "ok", outcome.error
    assert len(outcome.trajectory) > 0.8 * FRAMES
    assert room.ground_truth is not None
    assert ate(room.ground_truth, outcome.trajectory) < 0.05
