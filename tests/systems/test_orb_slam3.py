"""ORB-SLAM3 itself runs by its example; `make test-systems` installs it, without it there is nothing to test."""

import os
import subprocess
from pathlib import Path

import pytest

from gtf_tune.execution import InlineExecutor, RunLimits
from gtf_tune.metrics import ate
from gtf_tune.pipelines import create_pipeline
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.sequence import RoomSpec, Sequence, load_sequence, render_room

SYSTEM = Path(__file__).parents[2] / "examples" / "systems" / "orb_slam3"
FRAMES = 90


@pytest.fixture(scope="module")
def python() -> Path:
    found = Path(os.environ.get("GTF_TUNE_SYSTEMS", "/nowhere"), "orb_slam3", "bin", "python")
    if not found.exists():
        pytest.skip("ORB-SLAM3 is not installed: make test-systems")
    return found


@pytest.fixture(scope="module")
def room(python: Path, tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    """Return a rendered walk, with the vocabulary that is trained on it beside it."""
    folder = tmp_path_factory.mktemp("orb") / "room"
    render_room(folder, RoomSpec(num_frames=FRAMES, seed=5))
    train = [str(python), str(SYSTEM / "train_vocabulary.py"), str(folder.with_name("words.txt")), str(folder)]
    subprocess.run(train, check=True, capture_output=True)
    return load_sequence(folder)


def run(python: Path, room: Sequence, words: Path, **options: int) -> RunOutcome:
    settings = {"definition": str(SYSTEM / "orb_slam3.toml"), "python": str(python), "vocabulary": str(words)}
    pipeline = create_pipeline("command", settings)
    named = {f"ORBextractor.{name}": value for name, value in options.items()}
    request = RunRequest(pipeline, pipeline.options.check(named), room, "clean", 0, 0.0, 0, 0)
    return InlineExecutor().submit(request, RunLimits(600.0, 2**32)).result()


@pytest.mark.parametrize("features", [400, 1000])
def test_orb_slam3_tracks_a_rendered_walk(python: Path, room: Sequence, features: int) -> None:
    outcome = run(python, room, room.frames[0].path.parents[2] / "words.txt", nFeatures=features)

    assert outcome.status == "ok", outcome.error
    assert len(outcome.trajectory) > 0.8 * FRAMES
    assert room.ground_truth is not None
    assert ate(room.ground_truth, outcome.trajectory) < 0.05
