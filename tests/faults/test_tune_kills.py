"""A `gtf-tune tune` that dies or is stopped in any phase goes on as if nothing had happened when called again."""

import io
import json
import os
import signal
import sys
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from gtf_tune.execution import InlineExecutor
from tests.faults.disturbance import CONTEXT
from tests.pipelines.conftest import make_scene
from tests.study.conftest import write_sequence

ANALYTIC = """
[pipeline]
name = "analytic"
settings = { collapse_rate = 0.0 }

[[sequences]]
name = "room"
path = "room"

[space]
"filter.max_error" = { low = 1e-3, high = 1e-1, log = true }
"""
GLOMAP = """
[[sequences]]
name = "room"
path = "room"

[search]
first = [{ "mapper.bundle_adjustment.ceres.loss_function_scale" = 0.2 }]
baselines = {}
"""
SEARCH = """
[search]
first = [{ "filter.max_error" = 2e-3 }]
"""
PHASES = ("inspect:", "estimate:", "created study", "nominal (", "trial 2", "confirm:", "write:")
MODEL = ("reconstructing 8 images with the nominal options", "reconstructing 8 images with the options")


def tune(folder: Path, phase: str = "", number: signal.Signals = signal.SIGKILL, *, inline: bool = True) -> None:
    """Tune in this process, which gets a signal as soon as it says that a phase has begun."""
    from gtf_tune.cli import main
    from gtf_tune.cli import tune as command
    from gtf_tune.cli.terminal import tune_progress

    os.setsid()
    os.chdir(folder)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored where the tests run in the background
    say = command.say

    def disturbed(text: str) -> None:
        say(text)
        sys.stderr.flush()
        if phase and text.startswith(phase):
            signal.raise_signal(number)  # sent to the process, another thread may take it, and later

    command.say = tune_progress.say = disturbed  # type: ignore[attr-defined]
    if inline:
        command.make_executor = lambda *_: InlineExecutor()  # type: ignore[assignment,attr-defined]
    sys.argv = ["gtf-tune", "tune", "slam.toml", "--minutes", "60", "--jobs", "2", "--cache-dir", str(folder / "cache")]
    with (folder / "log").open("a") as log, redirect_stderr(log), redirect_stdout(io.StringIO()):
        main.main()


def ended(*arguments: object, **keywords: object) -> int | None:
    process = CONTEXT.Process(target=tune, args=arguments, kwargs=keywords)
    process.start()
    process.join()
    return process.exitcode


def outcome(folder: Path) -> dict[str, object]:
    """Return what an ended study has come to, without the times."""
    from gtf_tune.store import confirmations, studies, trials
    from gtf_tune.store.database import open_database

    database = open_database(str(folder / "gtf-tune.db"))
    (name,) = studies.names(database)
    study = studies.get(database, name)
    values = {trial.number: (trial.options, trial.value) for trial in trials.of_study(database, study.id)}
    verdicts = [found.verdict for found in confirmations.of_study(database, study.id)]
    database.close()
    options = json.loads((folder / "slam-tuned" / "options.json").read_text())
    return {"trials": values, "verdicts": verdicts, "options": options}


def prepare(folder: Path, definition: str) -> Path:
    folder.mkdir(parents=True)
    if definition.startswith(ANALYTIC):
        write_sequence(folder / "room", ground_truth=False)
    else:
        (folder / "room").mkdir()
        make_scene(folder / "room", frames=8)
    (folder / "slam.toml").write_text(definition.replace("[search]", "[search]\ntrials = 3"))
    return folder


@pytest.mark.parametrize(
    ("number", "phases"),
    [
        (signal.SIGKILL, ("estimate:", "trial 1", "confirm:", "write:")),
        (signal.SIGINT, ("estimate:", "trial 1", "write:")),
    ],
)
def test_tune_goes_on_after_each_phase(number: signal.Signals, phases: tuple[str, ...], tmp_path: Path) -> None:
    undisturbed, folder = (prepare(tmp_path / name, ANALYTIC + SEARCH) for name in ("undisturbed", "disturbed"))
    assert ended(undisturbed) == 0

    codes = [ended(folder, phase, number) for phase in phases]

    assert codes == [-number if number is signal.SIGKILL else 130] * len(phases)
    assert ended(folder) == 0
    assert outcome(folder) == outcome(undisturbed)
    if number is signal.SIGINT:
        assert (folder / "log").read_text().count("the same command goes on") == len(phases)


@pytest.mark.soak
def test_tune_of_images_goes_on_after_each_phase(tmp_path: Path) -> None:
    undisturbed, folder = (prepare(tmp_path / name, GLOMAP) for name in ("undisturbed", "disturbed"))
    assert ended(undisturbed, inline=False) == 0

    for phase in (*PHASES[:2], MODEL[0], *PHASES[2:], MODEL[1]):
        ended(folder, phase, inline=False)

    assert ended(folder, inline=False) == 0
    assert outcome(folder) == outcome(undisturbed)
    assert (folder / "slam-tuned" / "sparse" / "0" / "points3D.bin").is_file()
