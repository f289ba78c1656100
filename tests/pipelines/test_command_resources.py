"""What a program shares or is given: the CUDA device, settings files of every format, placeholders of the sequence."""

import json
import sys
from pathlib import Path

import pytest

from gtf_tune.execution import LocalExecutor
from gtf_tune.pipelines.analytic import imaginary_sequence
from gtf_tune.pipelines.command import CommandPipeline, create
from gtf_tune.sequence import Camera, Sequence
from gtf_tune.testing import ContractCase, FolderStages
from tests.execution.doubles import request_of
from tests.execution.executor_contract import LIMITS, WAIT_S

PYTHON = [sys.executable, "-I", "-S"]
POSES = "0 0 0 0 0 0 0 1\n"

# A stand-in for a program on a GPU: it notes that it is there, looks a while for another one, and notes what it saw.
GPU_USER = """
import os, sys, time
folder, me, patience_s, out = sys.argv[1:]
def here():
    return [name for name in os.listdir(folder) if name.startswith("on-device-")]
open(f"{folder}/on-device-{me}", "w").close()
until = time.monotonic() + float(patience_s)
met = False
while not met and time.monotonic() < until:
    met = len(here()) > 1 or os.path.exists(f"{folder}/met")
    time.sleep(0.005)
if met:
    open(f"{folder}/met", "w").close()
os.remove(f"{folder}/on-device-{me}")
open(out, "w").write("0 0 0 0 0 0 0 1\\n")
"""


def gpu_user(folder: Path, *, gpu: bool, patience_s: float) -> CommandPipeline:
    (folder / "program.py").write_text(GPU_USER)
    words = [*PYTHON, str(folder / "program.py"), str(folder), "{seed}", str(patience_s), "{output}"]
    return create({"arguments": words, "gpu": gpu, "output": {"association": "index"}})


def two_at_once(pipeline: CommandPipeline, folder: Path) -> list[str]:
    """Run a pipeline twice on an executor with two places, and return how the runs ended."""
    with LocalExecutor(jobs=2, scratch=folder / "scratch") as executor:
        futures = [executor.submit(request_of(pipeline, index), LIMITS) for index in range(2)]
        return [future.result(WAIT_S).status for future in futures]


def test_two_runs_side_by_side_never_use_the_device_at_once(tmp_path: Path) -> None:
    ended = two_at_once(gpu_user(tmp_path, gpu=True, patience_s=1.0), tmp_path)

    assert ended == ["ok", "ok"]
    assert not (tmp_path / "met").exists()


def test_two_runs_of_a_program_without_a_device_go_side_by_side(tmp_path: Path) -> None:
    ended = two_at_once(gpu_user(tmp_path, gpu=False, patience_s=30.0), tmp_path)

    assert ended == ["ok", "ok"]
    assert (tmp_path / "met").exists()


@pytest.fixture(scope="module")
def frames() -> Sequence:
    camera = Camera("OPENCV", 64, 48, (50.0, 51.0, 32.5, 24.5, 0.1, 0.0, 0.0, 0.0))
    return imaginary_sequence(3).with_camera(camera)


def seen_by(program: str, frames: Sequence, folder: Path, settings: dict[str, object], **options: object) -> object:
    """Run a program that writes what it sees to the file of its first argument, and return that."""
    (folder / "program.py").write_text(program)
    words = [*PYTHON, str(folder / "program.py"), str(folder / "seen"), "{output}"]
    more = settings.pop("words", [])
    assert isinstance(more, list)
    pipeline = create({"arguments": [*words, *more], "output": {"association": "index"}, **settings})
    ContractCase(pipeline, frames).run(folder / "run", FolderStages(folder / "stages"), options)
    return json.loads((folder / "seen").read_text())


def test_a_program_named_by_a_relative_path_is_that_of_the_current_folder(
    frames: Sequence, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "solver").write_text(f"#!/bin/sh\ncat > $1 <<END\n{POSES}END\n")
    (tmp_path / "solver").chmod(0o755)
    monkeypatch.chdir(tmp_path)
    pipeline = create({"arguments": ["./solver", "{output}"], "output": {"association": "index"}})

    found = ContractCase(pipeline, frames).run(tmp_path / "run", FolderStages(tmp_path / "stages"), {})

    assert len(found.trajectory) == 1


FILES = {
    "opencv.yaml": ("%YAML:1.0\nORB.n: 5   # corners\n", "%YAML:1.0\nORB.n: 6   # corners\n"),
    "nested.yml": ("a:\n  b: 0.5  # half\n", "a:\n  b: 0.25  # half\n"),
    "plain.ini": ("[Matching]\nratio = 0.8\n", "[Matching]\nratio = 0.7\n"),
    "deep.json": ('{"ba": {"window": 7, "list": [1]}}\n', '{"ba": {"window": 9, "list": [1]}}\n'),
    "some.toml": ('[loss]\nkernel = "huber" # robust\n', '[loss]\nkernel = "cauchy" # robust\n'),
}
KEYS = {
    "opencv.yaml": ("ORB.n", 5, 6),
    "nested.yml": ("a.b", 0.5, 0.25),
    "plain.ini": ("Matching.ratio", 0.8, 0.7),
    "deep.json": ("ba.window", 7, 9),
    "some.toml": ("loss.kernel", "huber", "cauchy"),
}
READS_FILES = f"""
import json, sys
open(sys.argv[1], "w").write(json.dumps([open(path).read() for path in sys.argv[3:]]))
open(sys.argv[2], "w").write({POSES!r})
"""


def test_one_program_may_read_settings_files_of_every_format(frames: Sequence, tmp_path: Path) -> None:
    for name, (before, _) in FILES.items():
        (tmp_path / name).write_text(before)
    options = {name: {"default": KEYS[name][1], "key": KEYS[name][0], "file": name} for name in FILES}
    settings: dict[str, object] = {
        "words": [f"{{settings_file:{name}}}" for name in FILES],
        "settings_files": [{"name": name, "template": str(tmp_path / name)} for name in FILES],
        "options": options,
    }

    seen = seen_by(READS_FILES, frames, tmp_path, settings, **{name: KEYS[name][2] for name in FILES})

    assert seen == [after for _, after in FILES.values()]
    assert [(tmp_path / name).read_text() for name in FILES] == [before for before, _ in FILES.values()]


@pytest.mark.parametrize(("words", "after"), [(("no", "yes"), "no"), (("0", "1"), "0"), (("false", "true"), "false")])
def test_an_ini_file_has_booleans_in_the_words_of_the_program(
    frames: Sequence, tmp_path: Path, words: tuple[str, str], after: str
) -> None:
    (tmp_path / "solver.ini").write_text(f"[loop]\nclosing = {words[1]}\n")
    settings: dict[str, object] = {
        "words": ["{settings_file}"],
        "settings_files": [{"template": str(tmp_path / "solver.ini")}],
        "boolean_words": words,
        "options": {"loops": {"default": True, "key": "loop.closing"}},
    }

    assert seen_by(READS_FILES, frames, tmp_path, settings, loops=False) == [f"[loop]\nclosing = {after}\n"]


READS_WORDS = f"""
import json, sys
words = dict(zip(sys.argv[3::2], sys.argv[4::2]))
words |= {{name: open(words[name]).read() for name in ("camera", "list", "times")}}
open(sys.argv[1], "w").write(json.dumps(words))
open(sys.argv[2], "w").write({POSES!r})
"""


def test_placeholders_stand_for_the_sequence_and_the_run(frames: Sequence, tmp_path: Path) -> None:
    fields = {
        "camera": "{camera}",
        "model": "{camera_model}",
        "params": "{camera_params}",
        "opencv": "{camera_fx} {camera_fy} {camera_cx} {camera_cy} {camera_k1}",
        "list": "{image_list}",
        "times": "{timestamps}",
        "size": "{width}x{height}, {num_images} images",
        "run": "seed {seed}, threads {threads}",
        "option": "blur={option:blur}",
        "braces": "{{images}}",
    }
    settings: dict[str, object] = {
        "words": [word for pair in fields.items() for word in pair],
        "options": {"blur": {"default": 1.5}},
    }

    seen = seen_by(READS_WORDS, frames, tmp_path, settings, blur=0.5)

    assert seen == {
        "camera": "1 OPENCV 64 48 50.0 51.0 32.5 24.5 0.1 0.0 0.0 0.0\n",
        "model": "OPENCV",
        "params": "50.0,51.0,32.5,24.5,0.1,0.0,0.0,0.0",
        "opencv": "50.0 51.0 32.0 24.0 0.1",
        "list": "000000.pgm\n000001.pgm\n000002.pgm\n",
        "times": "".join(f"{frame.timestamp!r}\n" for frame in frames.frames),
        "size": "64x48, 3 images",
        "run": "seed 7, threads 1",
        "option": "blur=0.5",
        "braces": "{images}",
    }
