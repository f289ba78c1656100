import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from gtf_tune.store import studies, trials
from gtf_tune.store.database import open_database
from tests.cli.conftest import Cli

CREATE = ("study", "create", "small", "-p", "analytic", "-s", "room", "-k", "1", "-K", "3", "--sampler", "random")
AXIS = ("-r", "filter.max_error=1e-3:1e-1:log")


def test_a_worker_serves_what_is_open_and_says_so(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "-n", "2")

    said = cli("worker", "--once", "--jobs", "1")

    assert said.code == 0
    assert "serving study 'small'" in said.err
    assert "small: trial 1 is done" in said.err
    assert "nothing is left to do" in said.err


def test_a_worker_says_which_trials_it_had_to_leave_and_fails_with_once(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "-n", "2")
    room.rename(room.with_name("elsewhere"))

    once = cli("worker", "--once", "--study", "small")
    idle = cli("worker", "--idle-exit", "0.01", "--study", "small")

    assert (once.code, idle.code) == (1, 0)
    assert "nothing is left" not in once.err + idle.err
    for said in (once, idle):
        last = said.err.splitlines()[-1]
        assert last.startswith("left 2 trials of study 'small' to other workers: sequence 'room' is not at")


def test_a_worker_leaves_in_one_way_only(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "-n", "2")

    said = cli("worker", "--once", "--idle-exit", "5")

    assert said.code == 1
    assert (
        said.err == "error: --once leaves as soon as nothing is left, --idle-exit S seconds later; give one of them\n"
    )


def test_a_paused_study_is_not_run_until_it_is_resumed(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "-n", "2")
    cli("study", "pause", "small")

    room.rename(room.with_name("elsewhere"))
    refused = cli("study", "run", "small", "--jobs", "1")
    room.with_name("elsewhere").rename(room)
    resumed = cli("study", "resume", "small", "--jobs", "1")

    assert (refused.code, resumed.code) == (1, 0)
    assert refused.err.splitlines()[-1] == "error: study 'small' is paused; resume it (gtf-tune study resume small)"
    assert "2/2" in resumed.err


def test_a_worker_says_why_a_named_study_is_not_served(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "-n", "2")
    cli("study", "stop", "small")

    stopped = cli("worker", "--once", "--study", "small")
    missing = cli("worker", "--once", "--study", "smal")
    awaited = cli("worker", "--idle-exit", "0.01", "--study", "later")

    assert "study 'small' is stopped; open it with: gtf-tune study resume small" in stopped.err
    assert (missing.code, awaited.code) == (1, 0)
    assert "there is no study 'smal'" in missing.err
    assert "did you mean 'small'" in missing.err
    assert "there is no study 'later' yet; waiting for it" in awaited.err


def test_a_place_for_a_sequence_that_the_study_has_not_is_refused(cli: Cli, room: Path) -> None:
    cli(*CREATE, *AXIS, "-n", "2")

    said = cli("study", "run", "small", "--sequence", "rom=room")

    assert said.code == 1
    assert said.err.splitlines()[-1] == (
        "error: study 'small' has no sequence 'rom', only room; name one of these (--sequence room=PATH)"
    )


def test_a_data_root_that_does_not_exist_is_a_usage_error(cli: Cli, room: Path) -> None:
    assert cli("worker", "--data-root", "nowhere").code == 2


@pytest.fixture
def busy_worker(cli: Cli, room: Path, tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """Yield a worker process in the middle of a trial whose noisy runs hang."""
    hanging = ("--name", "small", "-s", "room", "-n", "50")
    (tmp_path / "small.toml").write_text(
        'name = "small"\n[pipeline]\nname = "analytic"\nsettings = {failure = "hang", failure_rate = "0.3"}\n'
        '[space]\n"filter.max_error" = {low = 1e-3, high = 0.1, log = true}\n[search]\nsampler = "random"\n'
    )
    created = cli("study", "create", "small.toml", *hanging)
    assert created.code == 0, created.err
    command = [sys.executable, "-m", "gtf_tune", "worker", "--jobs", "2"]
    process = subprocess.Popen(command, cwd=tmp_path, stderr=subprocess.PIPE, text=True, env=os.environ)
    yield process
    process.kill()
    process.communicate()


@pytest.mark.parametrize(("signals", "code"), [([signal.SIGTERM], 130), ([signal.SIGINT, signal.SIGINT], 130)])
def test_a_worker_that_is_asked_to_end_keeps_its_runs_and_releases_its_trial_within_ten_seconds(
    busy_worker: subprocess.Popen[str], signals: list[signal.Signals], code: int, tmp_path: Path
) -> None:
    assert busy_worker.stderr is not None
    for line in busy_worker.stderr:
        if "begins" in line:
            break
    asked = time.monotonic()
    for number in signals:
        busy_worker.send_signal(number)
        said = next(line for line in busy_worker.stderr if "asked" in line or "finishing" in line or "stopping" in line)
        assert said
    ended = busy_worker.wait(30)

    assert time.monotonic() - asked < 10
    assert ended == code
    database = open_database(str(tmp_path / "gtf-tune.db"))
    study = studies.get(database, "small")
    (trial,) = trials.of_study(database, study.id)
    database.close()
    assert (trial.state, trial.heartbeat_at) == ("claimed", None)
