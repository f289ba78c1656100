"""SVO itself runs by its example; `make test-systems` installs it, without it there is nothing to test."""

from pathlib import Path

from gtf_tune.metrics import ate
from gtf_tune.sequence import RoomSpec, load_sequence, render_room
from tests.systems.conftest import RunSystem, python_of

FRAMES = 60


def test_svo_tracks_a_smooth_walk(run_system: RunSystem, tmp_path: Path) -> None:
    python_of("svo")
    render_room(tmp_path / "room", RoomSpec(num_frames=FRAMES, seed=5, frame_rate_hz=20.0, width=480, height=360))
    room = load_sequence(tmp_path / "room")

    outcome = run_system("svo", room, {"max_fts": 240})

    assert outcome.status == "ok", outcome.error
    assert len(outcome.trajectory) > 0.8 * FRAMES
    assert room.ground_truth is not None
    assert ate(room.ground_truth, outcome.trajectory) < 0.05
