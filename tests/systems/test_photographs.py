"""Programs for photographs run by their examples; `make test-systems` installs them, without it they are skipped."""

import pytest

from gtf_tune.metrics import ate
from gtf_tune.sequence import RoomSpec, Sequence, load_sequence, render_room
from tests.systems.conftest import RunSystem, python_of

FRAMES = 10


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Sequence:
    folder = tmp_path_factory.mktemp("photographs") / "room"
    render_room(folder, RoomSpec(num_frames=FRAMES, seed=5))
    return load_sequence(folder)


@pytest.mark.parametrize(
    ("system", "options"),
    [
        ("openmvg", {"engine": "incremental"}),
        ("openmvg", {"engine": "global", "features": "sift"}),
        ("theia", {"method": "incremental"}),
        ("theia", {"method": "global", "global_position_estimator_type": "NONLINEAR"}),
        ("learned_features", {"features": "sift"}),
        ("learned_features", {"features": "aliked", "max_features": 512}),
        ("learned_features", {"features": "disk", "max_features": 512}),
    ],
)
def test_a_program_places_the_cameras_of_a_room(
    run_system: RunSystem, room: Sequence, system: str, options: dict[str, object]
) -> None:
    python_of(system)

    outcome = run_system(system, room, options)

    assert outcome.status == "ok", outcome.error
    assert len(outcome.trajectory) >= 0.8 * FRAMES
    assert room.ground_truth is not None
    assert ate(room.ground_truth, outcome.trajectory) < 0.05
