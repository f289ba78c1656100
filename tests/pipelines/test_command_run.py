"""Small programs stand for real ones: how they are run, and every way in which they fail."""

import dataclasses
import json
import math
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gtf_tune.errors import RunError
from gtf_tune.pipelines import PipelineOutput
from gtf_tune.pipelines.analytic import ground_truth, imaginary_sequence
from gtf_tune.pipelines.command import CommandPipeline, create
from gtf_tune.pipelines.run import RunRequest
from gtf_tune.sequence import Camera, Frame, Sequence
from gtf_tune.testing import ContractCase, FolderStages, PipelineContract

FRAMES = 6
PYTHON = [sys.executable, "-I", "-S"]

# Walks along a line with a step that is an option, and says how it was called.
WALKER = """
import json, os, sys
arguments = dict(zip(sys.argv[1::2], sys.argv[2::2]))
step = float(arguments.get("--step", "1.0"))
times = open(arguments["--times"]).read().split()
names = open(arguments["--list"]).read().split()
assert all(os.path.exists(os.path.join(arguments["--images"], name)) for name in names)
with open(arguments["--out"], "w") as file:
    for index, time in enumerate(times):
        file.write(f"{time} {index * step} {float(arguments['--seed']) % 3} 0 0 0 0 1\\n")
print(json.dumps(sys.argv[1:]))
"""


@pytest.fixture(scope="session")
def frames() -> Sequence:
    """Return six black images whose frame ids are not their positions."""
    sequence = imaginary_sequence(FRAMES)
    spread = tuple(Frame(3 * frame.frame_id, frame.path, frame.timestamp) for frame in sequence.frames)
    camera = Camera("OPENCV", 64, 48, (50.0, 51.0, 32.0, 24.0, 0.1, 0.0, 0.0, 0.0))
    return dataclasses.replace(sequence, frames=spread, ground_truth=ground_truth(range(0, 18, 3))).with_camera(camera)


def script(folder: Path, code: str) -> str:
    path = folder / "program.py"
    path.write_text(code)
    return str(path)


def walker(folder: Path, **more: Any) -> CommandPipeline:
    words = "--images {images} --list {image_list} --times {timestamps} --out {output} --seed {seed} {options}"
    return create(
        {
            "arguments": [*PYTHON, script(folder, WALKER), *words.split()],
            "options": {"step": {"default": 1.0, "low": 0.0}, "label": {"default": "a", "choices": ["a", "b"]}},
            **more,
        }
    )


def writer(folder: Path, text: str, **output: Any) -> CommandPipeline:
    """Return a pipeline whose program writes a text as its trajectory."""
    code = f"import sys; open(sys.argv[1], 'w').write({text!r})"
    return create({"arguments": [*PYTHON, script(folder, code), "{output}"], "output": output})


def run(pipeline: CommandPipeline, sequence: Sequence, folder: Path, **options: Any) -> PipelineOutput:
    return ContractCase(pipeline, sequence).run(folder / "run", FolderStages(folder / "stages"), options)


class TestContract(PipelineContract):
    @pytest.fixture(scope="class")
    @classmethod
    def case(cls, frames: Sequence, tmp_path_factory: pytest.TempPathFactory) -> ContractCase:
        return ContractCase(walker(tmp_path_factory.mktemp("walker")), frames, {"step": 2.0})


def test_the_trajectory_is_that_of_the_program(frames: Sequence, tmp_path: Path) -> None:
    output = run(walker(tmp_path), frames, tmp_path, step=0.5)

    assert output.trajectory.frame_ids.tolist() == [0, 3, 6, 9, 12, 15]
    assert output.trajectory.positions.tolist() == [[0.5 * index, 7 % 3, 0] for index in range(FRAMES)]
    assert output.trajectory.names[1] == "000003.pgm"
    assert output.diagnostics["num_poses"] == FRAMES


@pytest.mark.parametrize(("association", "reads"), [("timestamp", True), ("index", False)])
def test_other_times_are_another_run_where_they_count(
    frames: Sequence, tmp_path: Path, association: str, reads: bool
) -> None:
    pipeline = writer(tmp_path, "", association=association)
    later = tuple(dataclasses.replace(frame, timestamp=frame.timestamp + 1) for frame in frames.frames)
    requests = [
        RunRequest(pipeline, {}, sequence, "clean", 0, 0.0, 0, 0)
        for sequence in (frames, dataclasses.replace(frames, frames=later))
    ]

    assert (requests[0].key != requests[1].key) == reads


def test_a_cached_step_that_reads_times_is_run_again_for_others(
    frames: Sequence, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    code = "open('output', 'w').write('0 0 0 0 0 0 0 1')"
    step = {"name": "match", "arguments": [*PYTHON, script(tmp_path, code), "{timestamps}"], "cached": True}
    last = {"name": "map", "arguments": [*PYTHON, script(tmp_path, code)]}
    pipeline = create({"steps": [step, last], "output": {"association": "index"}})
    later = tuple(dataclasses.replace(frame, timestamp=frame.timestamp + 1) for frame in frames.frames)
    stages = FolderStages(tmp_path / "stages")

    for number, sequence in enumerate((frames, frames, dataclasses.replace(frames, frames=later))):
        ContractCase(pipeline, sequence).run(tmp_path / str(number), stages, {})

    assert capfd.readouterr().out.count(f"{sys.executable} -I -S") == 2 + 3


def test_only_changed_options_are_passed_unless_asked(
    frames: Sequence, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    run(walker(tmp_path), frames, tmp_path / "a", step=2.0)
    run(walker(tmp_path, options_passed="all"), frames, tmp_path / "b", step=2.0)

    called = [json.loads(line)[10:] for line in capfd.readouterr().out.splitlines() if line.startswith("[")]
    assert called == [["--step", "2.0"], ["--label", "a", "--step", "2.0"]]


@pytest.mark.parametrize(
    ("code", "reason"),
    [
        ("import sys; print('no features'); sys.exit(3)", r"python\S* ended with exit code 3; its last words: no feat"),
        ("import os; os.abort()", "was ended by SIGABRT"),
        ("import ctypes; ctypes.string_at(0)", "was ended by SIGSEGV"),
        ("import os; os.kill(os.getpid(), 9)", "was ended by SIGKILL, most likely for want of memory"),
        ("pass", "ended well but wrote no trajectory"),
    ],
)
def test_a_program_that_fails_is_a_run_with_a_reason(frames: Sequence, tmp_path: Path, code: str, reason: str) -> None:
    pipeline = create({"arguments": [*PYTHON, script(tmp_path, code)]})

    with pytest.raises(RunError, match=reason):
        run(pipeline, frames, tmp_path)


GOOD = [f"{index / 30!r} {index}.0 0 0 0 0 0 1" for index in range(FRAMES)]


@pytest.mark.parametrize(
    ("lines", "reason"),
    [
        ([], "holds none"),
        ([*GOOD[:3], GOOD[3][:9]], "line 4: expected 8 numbers"),
        ([*GOOD[:3], "0.1 nan 0 0 0 0 0 1"], "NaN"),
        ([GOOD[1], GOOD[0]], "sort the file"),
        ([GOOD[0], GOOD[0]], "drop the line"),
        ([*GOOD, "9.9 0 0 0 0 0 0 1"], r"1 of its 7 poses belong to no image within 0\.001 s, the first at 9\.9"),
        (["0.0 0 0 0 0 0 0 0"], "unit quaternion"),
    ],
)
def test_an_unusable_trajectory_is_a_run_with_a_reason(
    frames: Sequence, tmp_path: Path, lines: list[str], reason: str
) -> None:
    with pytest.raises(RunError, match=f"(?s)trajectory cannot be used: .*{reason}"):
        run(writer(tmp_path, "\n".join(lines)), frames, tmp_path)


def _indexed(rows: Mapping[int, str], end: str = "") -> str:
    return "".join(f"{row} {place} 0 0 0 0 0 1{end}\n" for place, row in rows.items())


COLMAP_IMAGES = "1 1 0 0 0 -2 0 0 1 000003.pgm\n\n2 1 0 0 0 -1 0 0 1 sub/000000.pgm\n\n"
QUARTER = math.sqrt(0.5)


@pytest.mark.parametrize(
    ("text", "output", "expected"),
    [
        (_indexed({1: "0", 2: "4"}), {"association": "index"}, {0: 1, 12: 2}),
        (_indexed({1: "0.0", 2: "0.1333333"}), {"association": "index", "time_scale": 30.0}, {0: 1, 12: 2}),
        ("".join(GOOD[i] + "\n" for i in (0, 4)), {}, {0: 0, 12: 4}),
        ("# ts\n133333333 7 0 0 0 0 0 1\n0 5 0 0 0 0 0 1\n", {"time_scale": 1e-9, "sort": True}, {0: 5, 12: 7}),
        ("ts (ns),x,y,z,a,b,c,d\n33333333,7,0,0,0,0,0,1\n", {"time_scale": 1e-9, "delimiter": ","}, {3: 7}),
        ("33333333,7,0,0,1,0,0,0\n", {"format": "euroc"}, {3: 7}),
        (
            "".join(f"1 0 0 {place} 0 1 0 0 0 0 1 0\n" for place in range(FRAMES)),
            {"format": "kitti", "association": "row"},
            {3 * place: place for place in range(FRAMES)},
        ),
        (f"0 0 -5 0 0 0 {QUARTER} {QUARTER}\n", {"association": "index", "poses": "camera_from_world"}, {0: 5}),
    ],
)
def test_poses_find_their_frames(
    frames: Sequence, tmp_path: Path, text: str, output: Mapping[str, Any], expected: Mapping[int, float]
) -> None:
    found = run(writer(tmp_path, text, **output), frames, tmp_path).trajectory

    places = dict(zip(found.frame_ids.tolist(), found.positions[:, 0].tolist(), strict=True))
    assert places == pytest.approx(dict(expected))


def test_the_largest_of_several_colmap_models_counts(frames: Sequence, tmp_path: Path) -> None:
    code = (
        "import os, sys\nfor number, text in enumerate(sys.argv[2:]):\n"
        "    os.makedirs(f'{sys.argv[1]}/{number}')\n    open(f'{sys.argv[1]}/{number}/images.txt', 'w').write(text)"
    )
    small = "1 1 0 0 0 -9 0 0 1 000000.pgm\n\n"
    words = [*PYTHON, script(tmp_path, code), "{output}", small, COLMAP_IMAGES, small]
    pipeline = create({"arguments": words, "output": {"format": "colmap", "association": "name"}})

    found = run(pipeline, frames, tmp_path).trajectory

    assert found.frame_ids.tolist() == [0, 3]
    assert found.positions[:, 0].tolist() == [1, 2]


@pytest.mark.parametrize(
    ("text", "output", "reason"),
    [
        (_indexed({1: "6"}), {"association": "index"}, "no position in the list of 6 images"),
        (_indexed({1: "0.5"}), {"association": "index"}, "no position"),
        (_indexed({1: "0", 2: "0.01"}), {"association": "index"}, "two of its poses belong to one image"),
        ("1 0 0 1 0 1 0 0 0 0 1 0\n", {"format": "kitti", "association": "row"}, "1 poses for 6 images"),
    ],
)
def test_poses_without_frames_are_refused(
    frames: Sequence, tmp_path: Path, text: str, output: Mapping[str, Any], reason: str
) -> None:
    with pytest.raises(RunError, match=reason):
        run(writer(tmp_path, text, **output), frames, tmp_path)


def test_unknown_images_in_a_model_are_refused(frames: Sequence, tmp_path: Path) -> None:
    code = "import os, sys; os.makedirs(sys.argv[1]); open(sys.argv[1] + '/images.txt', 'w').write(sys.argv[2])"
    words = [*PYTHON, script(tmp_path, code), "{output}", COLMAP_IMAGES.replace("000003", "000001")]
    pipeline = create({"arguments": words, "output": {"format": "colmap", "association": "name"}})

    with pytest.raises(RunError, match=r"image '000001\.pgm', which the program was not given"):
        run(pipeline, frames, tmp_path)


STEPS = """
import sys
step, state, out, *words = sys.argv[1:]
print("ran", step)
if step == "first":
    open(state + "/numbers", "w").write(" ".join(words))
elif step == "second":
    open(state + "/numbers", "a").write(" " + " ".join(words))
else:
    numbers = open(state + "/numbers").read().split() + words
    open(out, "w").write(f"0 {len(numbers)} {sum(map(float, numbers[1::2]))} 0 0 0 0 1\\n")
"""


def three_steps(folder: Path) -> CommandPipeline:
    program = script(folder, STEPS)
    names = ("first", "second", "third")
    return create(
        {
            "steps": [
                {
                    "name": name,
                    "cached": name != "third",
                    "arguments": [*PYTHON, program, name, "{state}", "{output}", "{options}"],
                }
                for name in names
            ],
            "options": {f"{name}_size": {"default": 1, "step": name} for name in names},
            "options_passed": "all",
            "output": {"association": "index"},
        }
    )


def test_cached_steps_run_again_only_where_something_changed(
    frames: Sequence, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    case, stages = ContractCase(three_steps(tmp_path), frames), FolderStages(tmp_path / "stages")

    def ran(number: int, options: Mapping[str, int]) -> tuple[list[str], float]:
        output = case.run(tmp_path / f"run{number}", stages, options)
        words = [line.split()[1] for line in capfd.readouterr().out.splitlines() if line.startswith("ran ")]
        assert output.trajectory.positions[0, 0] == 6
        return words, output.trajectory.positions[0, 1]

    assert ran(0, {}) == (["first", "second", "third"], 3)
    assert ran(1, {"third_size": 5}) == (["third"], 7)
    assert ran(2, {"second_size": 5}) == (["second", "third"], 7)
    assert ran(3, {"first_size": 5}) == (["first", "second", "third"], 7)
    assert ran(4, {"first_size": 5, "third_size": 4}) == (["third"], 10)


def test_a_failing_step_is_named(frames: Sequence, tmp_path: Path) -> None:
    fails = script(tmp_path, "raise SystemExit('no matches')")
    pipeline = create({"steps": [{"name": "match", "arguments": [*PYTHON, fails]}]})

    with pytest.raises(RunError, match=r"^step 'match' \(python\S*\) ended with exit code 1; its last words: no match"):
        run(pipeline, frames, tmp_path)


def test_what_a_program_needs_is_put_before_it(frames: Sequence, tmp_path: Path) -> None:
    (tmp_path / "settings.yaml").write_text("%YAML:1.0\nCamera.fx: 1.0\nORB.n: 5\nOther: 1\n")
    (tmp_path / "data").mkdir()
    code = """
import json, os, sys
lines = {name: open(name).read() for name in ("a/list.txt", "settings.yaml", "calibration.txt")}
lines["images"] = sorted(os.listdir("mav/data")) + os.listdir("weights/..")[:0]
lines["argv"], lines["variable"], lines["optional"] = sys.argv[1:], os.environ["VARIABLE"], os.path.exists("no.txt")
print("seen", json.dumps(lines))
open("output", "w").write("0 0 0 0 0 0 0 1\\n")
"""
    pipeline = create(
        {
            "arguments": [*PYTHON, "{program}", "{settings_file}", ["--no", "{file:no.txt}"], ["--fx", "{camera_fx}"]],
            "parameters": {
                "program": {"kind": "file"},
                "weights": {"kind": "folder"},
                "template": {"kind": "file"},
                "unset": {"default": ""},
            },
            "program": script(tmp_path, code),
            "weights": str(tmp_path / "data"),
            "template": str(tmp_path / "settings.yaml"),
            "images": {"folder": "mav/data", "name": "{timestamp_ns}.png"},
            "files": [
                {"path": "a/list.txt", "text": "# {{list}}\n", "each_frame": "{index} {timestamp_s:.3f} {name}"},
                {"path": "calibration.txt", "text": "{camera_cx} {camera_distortion} {fps:d}\n{width}x{height} \n"},
                {"path": "no.txt", "text": "{unset}", "optional": True},
                {"path": "weights", "link": "{weights}"},
            ],
            "settings_files": [
                {"template": "{template}", "values": {"Camera.fx": "{camera_fx}", "Other": "{unset}", "ORB.n": 6}}
            ],
            "environment": {"VARIABLE": "{threads} of {num_images}"},
            "output": {"association": "index"},
        }
    )
    log = tmp_path / "log"

    seen = _seen(lambda: run(pipeline, frames, tmp_path), log)

    assert seen["images"] == sorted(f"{round(1e9 * index / 30)}.png" for index in range(FRAMES))
    assert seen["a/list.txt"].splitlines()[:3] == ["# {list}", "0 0.000 0.png", "1 0.033 33333333.png"]
    assert seen["calibration.txt"] == "31.5 0.1 0.0 0.0 0.0 30\n64x48\n"
    assert seen["settings.yaml"] == "%YAML:1.0\nCamera.fx: 50.0\nORB.n: 6\nOther: 1\n"
    assert seen["argv"][1:] == ["--fx", "50.0"]
    assert (seen["variable"], seen["optional"]) == ("1 of 6", False)


def test_a_settings_file_keeps_its_ends_of_lines(frames: Sequence, tmp_path: Path) -> None:
    (tmp_path / "settings.ini").write_bytes(b"[a]\r\nb=1\r\nc=2\r\n")
    code = """
import json, sys
print("seen", json.dumps(open(sys.argv[1], newline="").read()))
open("output", "w").write("0 0 0 0 0 0 0 1\\n")
"""
    template = {"template": str(tmp_path / "settings.ini"), "values": {"a.c": 3}}
    words = [*PYTHON, script(tmp_path, code), "{settings_file}"]
    pipeline = create({"arguments": words, "settings_files": [template], "output": {"association": "index"}})

    assert _seen(lambda: run(pipeline, frames, tmp_path), tmp_path / "log") == "[a]\r\nb=1\r\nc=3\r\n"


def _seen(action: Callable[[], object], log: Path) -> Any:
    from gtf_tune.execution.process import output_to

    with output_to(log):
        action()
    return json.loads(next(line for line in log.read_text().splitlines() if line.startswith("seen "))[5:])


def test_a_program_that_wants_intrinsics_says_so(frames: Sequence, tmp_path: Path) -> None:
    pipeline = create({"arguments": [*PYTHON, script(tmp_path, ""), "{camera_fx}"]})
    unknown = frames.with_camera(None)
    fisheye = frames.with_camera(Camera("FOV", 64, 48, (50.0, 50.0, 32.0, 24.0, 0.9)))

    for number, sequence in enumerate((unknown, fisheye)):
        with pytest.raises(RunError, match=r"\{camera_fx\}.*give the camera of the sequence"):
            run(pipeline, sequence, tmp_path / str(number))


def test_noise_reaches_the_program(frames: Sequence, tmp_path: Path) -> None:
    code = "import sys; open(sys.argv[2], 'w').write(f'0 {sum(open(sys.argv[1], \"rb\").read()[-99:])} 0 0 0 0 0 1')"
    words = [*PYTHON, script(tmp_path, code), "{images}/000000.pgm", "{output}"]
    pipeline = create({"arguments": words, "output": {"association": "index"}})
    job = ContractCase(pipeline, frames).job(tmp_path / "run", FolderStages(tmp_path / "stages"), {})

    noisy = dataclasses.replace(job, images=dataclasses.replace(job.images, sigma=20.0, seed=1))

    assert np.all(pipeline.run(noisy).trajectory.positions[0, 0] > 100)
