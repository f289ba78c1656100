"""Programs as people write them: a script without a guard, a prompt, a notebook; their functions run in processes."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

HEAD = """
import os
import numpy as np
import gtf_tune as gtf
print("main", __name__)
SCALE = 0.5
def scaled(value): return SCALE * value
def my_slam(images, options, seed):
    angles = images.frame_ids / 10
    if options["crash"]: os.abort()
    noise = scaled(options["max_error"]) * (float(np.std(images.arrays[0])) + 0.1)
    shaken = np.random.default_rng(seed).normal(scale=noise, size=(len(images), 3))
    positions = np.stack([np.cos(angles), np.sin(angles), 0.2 * np.sin(3 * angles)], axis=1) + shaken
    return positions, np.tile([0.0, 0.0, 0.0, 1.0], (len(images), 1))
"""
CREATE = """
space = {"max_error": [0.001, 0.002], "crash": [False, True]}
gtf.create_study(
    NAME, sequence="photos", pipeline=my_slam, space=space, nominal={"max_error": 0.001, "crash": False},
    trials=2, gtf={"clean_runs": 1, "noisy_runs": 2, "noise_sigma": 5.0}, search={"sampler": "grid"},
)
print(len(gtf.open_study(NAME, pipeline=my_slam).run(jobs=1).trials), "trials")
"""
GO_ON = """
study = gtf.open_study(NAME, pipeline=my_slam).run(4, jobs=1)
print(*("feasible" if trial.feasible else trial.message for trial in study.trials), sep="; ")
"""


def run(arguments: list[str], stdin: str = "") -> list[str]:
    done = subprocess.run(
        [sys.executable, *arguments], input=stdin, capture_output=True, text=True, timeout=300, env={**os.environ}
    )
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr, done.stderr
    return done.stdout.split("\n")


def test_a_script_tunes_its_function_and_goes_on_with_it_later(folder: Path) -> None:
    (folder / "script.py").write_text(HEAD + CREATE.replace("NAME", "'script'"))
    (folder / "later.py").write_text(HEAD + GO_ON.replace("NAME", "'script'"))

    first, second = (run([name]) for name in ("script.py", "later.py"))

    assert first == ["main __main__", "2 trials", ""]
    assert second[0] == "main __main__"
    assert second[1].count("feasible") == second[1].count("the pipeline crashed its process (SIGABRT)") == 2


def test_lines_at_a_prompt_tune_their_function(folder: Path) -> None:
    block = "\n".join(f"{line}\n" if line.startswith("    return positions") else line for line in HEAD.split("\n"))

    shown = run(
        ["-i"],
        block.replace("def scaled(value): return SCALE * value", "scaled = lambda value: SCALE * value")
        + CREATE.replace("NAME", "'prompt'"),
    )

    assert shown.count("main __main__") == 1
    assert "2 trials" in shown


def test_a_notebook_tunes_its_function(folder: Path) -> None:
    """Its cells are executed in a main module that is no file."""
    (folder / "cells.txt").write_text(HEAD + CREATE.replace("NAME", "'notebook'"))
    kernel = "import __main__; exec(open('cells.txt').read(), __main__.__dict__)"

    assert run(["-c", kernel]) == ["main __main__", "2 trials", ""]
