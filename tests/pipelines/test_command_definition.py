"""Definitions of commands are checked whole, and identify exactly what results depend on."""

import errno
import hashlib
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtf_tune.errors import DefinitionError, OptionError, RunError
from gtf_tune.pipelines.command import create
from gtf_tune.pipelines.command.camera import opencv_camera
from gtf_tune.pipelines.command.places import rooted
from gtf_tune.pipelines.command.templates import fields_of, filled, filled_arguments
from gtf_tune.sequence import Camera

PROGRAM = [sys.executable, "-c", "pass"]


def faults(settings: Mapping[str, object]) -> str:
    with pytest.raises(DefinitionError) as caught:
        create(settings)
    return str(caught.value)


@pytest.mark.parametrize(
    ("settings", "fault"),
    [
        ({}, r"needs to know a program: give the setting 'preset' \(one of colmap-3\.8, .*orb_slam3"),
        ({"preset": "orbslam3"}, r"no preset 'orbslam3'; did you mean 'orb_slam3' or 'orb_slam2'\?$"),
        ({"preset": "zzz"}, "no preset 'zzz'; known are colmap-3.8, "),
        ({"preset": "dso", "definition": "x.toml"}, "either 'preset' or 'definition'"),
        ({"definition": "/no/such.toml"}, "no readable TOML file"),
        ({"arguments": PROGRAM, "steps": [{"name": "a", "arguments": PROGRAM}]}, "either 'arguments'"),
        ({"arguments": ["no-such-program-here"]}, "no program 'no-such-program-here'"),
        ({"arguments": [["{camera_fx}"]]}, "must start with a program"),
        ({"arguments": [*PROGRAM, "{imges}"]}, "unknown placeholder '{imges}'"),
        ({"arguments": [*PROGRAM, "{seed:zz}"]}, "'{seed:zz}' has no format"),
        ({"arguments": [*PROGRAM, "{images"]}, "is no template"),
        ({"arguments": [*PROGRAM, "{images.__class__}"]}, "which is no name"),
        ({"arguments": [*PROGRAM, "{images[0]}"]}, "which is no name"),
        ({"arguments": [*PROGRAM, "{option:x}"]}, "'{option:x}' names no option"),
        ({"arguments": [*PROGRAM, "{settings_file}"]}, "names no settings file"),
        ({"arguments": [*PROGRAM, "{file:a}"]}, "names no file"),
        ({"arguments": PROGRAM, "option_arguments": ["--{nam}"]}, "option_arguments: unknown placeholder '{nam}'"),
        (
            {"arguments": [*PROGRAM, "{options}"], "options": {"x": {"default": 1, "arguments": ["{valu}"]}}},
            "option 'x': unknown placeholder '{valu}'",
        ),
        ({"arguments": PROGRAM, "options": {"x": {"default": 1}}}, "option 'x' reaches no program"),
        ({"arguments": PROGRAM, "options": {"x": {"default": 1, "key": "a"}}}, "belongs to no settings file"),
        ({"arguments": [*PROGRAM, "{options}"], "options": {"x": {"default": 1, "step": "a"}}}, "no step 'a'"),
        ({"arguments": [*PROGRAM, "{options}"], "options": {"x": {"default": 1, "low": 2}}}, r"outside \[2, inf\]"),
        ({"arguments": [*PROGRAM, "{options}"], "options": {"x": {"default": "a", "choices": ["b"]}}}, "its choices"),
        ({"arguments": [*PROGRAM, "{options}"], "options": {"x": {"default": 1, "choices": ["1"]}}}, "texts only"),
        ({"arguments": PROGRAM, "output": {"path": "../x"}}, "must lie inside the workspace"),
        ({"arguments": PROGRAM, "environment": {"A=B": "1"}}, "no variable can be called 'A=B'"),
        ({"arguments": PROGRAM, "files": [{"path": "/etc/x"}]}, "must lie inside the workspace"),
        ({"arguments": PROGRAM, "images": {"name": "{index}.jpg"}}, r"must end in \.pgm or \.png"),
        ({"arguments": PROGRAM, "output": {"format": "colmap"}}, "associated by 'name'"),
        ({"arguments": PROGRAM, "output": {"format": "kitti"}}, "its association is 'row'"),
        ({"arguments": PROGRAM, "outputs": {}}, r"unknown setting 'outputs'; did you mean 'output' or"),
        ({"arguments": PROGRAM, "output": {"formt": "tum"}}, "unknown key 'output.formt'"),
        ({"arguments": PROGRAM, "parameters": {"images": {}}, "images": {}}, "cannot be called 'images'"),
        ({"arguments": PROGRAM, "parameters": {"x": {"kind": "file"}}}, "the file 'x' is missing"),
        ({"arguments": PROGRAM, "parameters": {"x": {"kind": "file"}}, "x": "/no/file"}, "no file /no/file"),
        ({"arguments": PROGRAM, "parameters": {"x": {"kind": "folder"}}, "x": "/no/dir"}, "no folder /no/dir"),
        ({"arguments": PROGRAM, "parameters": {"x": {"kind": "executable"}}, "x": "/no/exe"}, "no program '/no/exe'"),
        ({"arguments": PROGRAM, "parameters": {"x": {"kind": "arguments"}}, "x": "a b"}, "must be a list of words"),
        ({"arguments": PROGRAM, "parameters": {"x": {"choices": ["a"]}}, "x": "b"}, "one of a, not 'b'"),
        ({"arguments": PROGRAM, "version_command": ["no-such-program-here"]}, "version command .* failed"),
        ({"arguments": PROGRAM, "version_command": PROGRAM}, "did not print what is expected"),
        ({"steps": [{"name": "a/b", "arguments": PROGRAM}]}, "letters, digits"),
        ({"steps": [{"name": "a", "arguments": PROGRAM}] * 2}, "different names"),
        ({"steps": [{"name": n, "arguments": PROGRAM, "cached": n == "b"} for n in "ab"]}, "cached steps must come"),
    ],
)
def test_a_fault_is_told(settings: Mapping[str, object], fault: str) -> None:
    assert re.search(fault, faults(settings))


def test_all_faults_are_told_at_once() -> None:
    told = faults(
        {
            "arguments": [*PROGRAM, "{nothing}"],
            "images": {"name": "a.jpg"},
            "folders": ["/tmp"],
            "parameters": {"x": {"kind": "file"}},
            "colour": 1,
        }
    )

    assert told.startswith("pipeline 'command' (settings): 5 faults: (1) ")
    for fault in ("{nothing}", "a.jpg", "/tmp", "file 'x' is missing", "'colour'"):
        assert fault in told


def test_an_option_of_one_step_may_not_be_read_by_another_when_steps_are_cached() -> None:
    steps = [
        {"name": "a", "cached": True, "arguments": [*PROGRAM, "{options}"]},
        {"name": "b", "arguments": [*PROGRAM, "{option:x}"]},
    ]

    assert "read outside step 'a'" in faults({"steps": steps, "options": {"x": {"default": 1, "step": "a"}}})


def of_one_step(readers: str, step: str = "a") -> dict[str, Any]:
    words = {name: [*PROGRAM, *(["{settings_file:s}"] if name in readers else [])] for name in "ab"}
    return {
        "steps": [{"name": name, "cached": name == "a", "arguments": words[name]} for name in "ab"],
        "settings_files": [{"name": "s", "template": "/nowhere/s.yaml", "path": "s.yaml", "step": step}],
        "options": {"x": {"default": 1, "step": "a", "key": "x", "file": "s"}},
    }


@pytest.mark.parametrize(
    ("readers", "step", "fault"),
    [
        ("ab", "a", "settings file 's' is of step 'a' but also read by step 'b'"),
        ("a", "c", "settings file 's': there is no step 'c'"),
        ("a", "", "option 'x' is read outside step 'a'"),
    ],
)
def test_a_settings_file_of_one_step_is_read_by_no_other(readers: str, step: str, fault: str) -> None:
    assert fault in faults(of_one_step(readers, step))


def test_options_are_checked_like_those_of_every_pipeline() -> None:
    pipeline = create(
        {
            "arguments": [*PROGRAM, "{options}"],
            "options": {"rate": {"default": 0.5, "low": 0.0, "high": 1.0, "documentation": "How fast."}},
        }
    )

    assert pipeline.options.check({"rate": 1}) == {"rate": 1.0}
    assert pipeline.options.specs["rate"].documentation == "How fast."
    with pytest.raises(OptionError, match="must lie in"):
        pipeline.options.check({"rate": 2.0})


def test_defaults_come_from_the_settings_file(tmp_path: Path) -> None:
    template = tmp_path / "orb.yaml"
    template.write_text("%YAML:1.0\nORB.n: 2000\nORB.on: 0\n")
    settings: dict[str, Any] = {
        "arguments": [*PROGRAM, "{settings_file}"],
        "settings_files": [{"template": str(template)}],
        "options": {"n": {"default": 1000, "key": "ORB.n"}, "on": {"default": True, "key": "ORB.on"}},
    }

    specs = create(settings).options.specs

    assert (specs["n"].default, specs["on"].default) == (2000, False)
    template.write_text("%YAML:1.0\nORB.m: 2000\nORB.on: often\n")
    told = faults(settings)
    assert "no key 'ORB.n'; did you mean" in told
    assert "takes true or false, not 'often'" in told


def test_a_definition_file_takes_the_users_parameters_and_changes(tmp_path: Path) -> None:
    (tmp_path / "solver.toml").write_text(
        "arguments = ['{program}', '{options}']\n[parameters]\nprogram = { kind = 'executable' }\n"
        "[options]\na = { default = 1 }\nb = { default = 2 }\n"
    )
    pipeline = create(
        {
            "definition": str(tmp_path / "solver.toml"),
            "program": sys.executable,
            "options": {"b": {"default": 3}, "c": {"default": 4}},
            "exit_codes": [0, 2],
        }
    )

    defaults = {name: spec.default for name, spec in pipeline.options.specs.items()}
    assert defaults == {"a": 1, "b": 3, "c": 4}
    assert pipeline.command.definition.exit_codes == (0, 2)


def test_the_identity_follows_contents_and_not_places(tmp_path: Path) -> None:
    def identity(name: str, text: str, **more: object) -> str:
        (tmp_path / name).write_text(text)
        settings = {"arguments": [*PROGRAM, "{weights}"], "parameters": {"weights": {"kind": "file"}}}
        return create({**settings, "weights": str(tmp_path / name), **more}).settings["identity"]

    first = identity("a", "one")
    assert identity("b", "one") == first
    assert identity("b", "one", description="words") == first
    assert identity("a", "two") != first
    assert identity("b", "one", environment={"X": "1"}) != first


def test_ranges_and_documentation_do_not_change_the_identity() -> None:
    def identity(**option: object) -> str:
        return create({"arguments": [*PROGRAM, "{options}"], "options": {"x": option}}).settings["identity"]

    assert identity(default=1) == identity(default=1, low=0, high=9, documentation="x")
    assert identity(default=1) != identity(default=2)


def test_a_literal_script_counts_by_its_contents(tmp_path: Path) -> None:
    script = tmp_path / "run.py"
    identities = set()
    for text in ("pass", "pass  # changed"):
        script.write_text(text)
        identities.add(create({"arguments": [sys.executable, str(script)]}).settings["identity"])

    assert len(identities) == 2


@pytest.mark.parametrize("place", ["template", "link"])
def test_a_literal_settings_file_or_link_counts_by_its_contents(tmp_path: Path, place: str) -> None:
    named = tmp_path / "settings.yaml"
    tables = {
        "template": {"settings_files": [{"template": str(named)}]},
        "link": {"files": [{"path": "settings.yaml", "link": str(named)}]},
    }
    identities = set()
    for text in ("a: 1\n", "a: 2\n"):
        named.write_text(text)
        identities.add(create({"arguments": PROGRAM, **tables[place]}).settings["identity"])

    assert len(identities) == 2


@pytest.mark.parametrize(
    ("tables", "reason"),
    [
        ({"version_pattern": "v("}, r"version_pattern: 'v\(' is no regular expression"),
        ({"version_command": ["{seed}"]}, "'version_command' must start with a program"),
        ({"version_command": [sys.executable, "--version"], "version_pattern": "P(q)?"}, "did not print what is exp"),
    ],
)
def test_a_version_that_cannot_be_told_is_one_sentence(tables: dict[str, object], reason: str) -> None:
    with pytest.raises(DefinitionError, match=reason):
        create({"arguments": PROGRAM, **tables})


def test_the_version_is_what_the_program_says() -> None:
    says = [sys.executable, "-c", "print(); print('Solver 1.2 (abc)')"]

    assert create({"arguments": PROGRAM, "version_command": says}).version == "Solver 1.2 (abc)"
    assert create({"arguments": PROGRAM, "version_command": says, "version_pattern": r"r (\S+)"}).version == "1.2"
    assert create({"arguments": PROGRAM}).version.startswith("sha256:")


def test_the_version_is_that_of_the_program_and_not_of_its_launcher_only(tmp_path: Path) -> None:
    program = tmp_path / "solver"
    versions = set()
    for text in ("#!/bin/sh\n", "#!/bin/sh\n# rebuilt\n"):
        program.write_text(text)
        program.chmod(0o755)
        tables = {
            "arguments": ["{launcher}", "{solver}"],
            "parameters": {"launcher": {"kind": "arguments"}, "solver": {"kind": "executable"}},
        }
        versions.add(create({**tables, "launcher": ["env", "A=1"], "solver": str(program)}).version)

    assert len(versions) == 2


def test_a_program_that_may_be_run_but_not_read_is_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    program = tmp_path / "solver"
    program.write_text("#!/bin/sh\n")
    program.chmod(0o711)

    def refuse(*_: object) -> None:
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(hashlib, "file_digest", refuse)

    assert re.search(r"solver cannot be read \(Permission denied\)", faults({"arguments": [str(program)]}))


def test_groups_without_a_value_are_left_out_and_lists_spread() -> None:
    arguments = ("{launcher}", "a", ("--fx", "{camera_fx}"), ("--n", "{n}"))

    words = filled_arguments(arguments, {"launcher": ("x", "-y"), "n": 1.5}, ("no", "yes"))

    assert words == ["x", "-y", "a", "--n", "1.5"]


def test_a_format_that_does_not_fit_is_a_reason() -> None:
    with pytest.raises(RunError, match=r"the format '\.3f' does not fit 'a'; correct the placeholder"):
        filled("{seed:.3f}", {"seed": "a"})


def test_values_are_written_exactly() -> None:
    assert (
        filled("{a} {b} {c:.2f} {d:d} {{x}}", {"a": 0.1, "b": True, "c": 1 / 3, "d": 2.6}, ("0", "1"))
        == "0.1 1 0.33 3 {x}"
    )


@given(st.text())
def test_no_template_is_evaluated(text: str) -> None:
    try:
        names = fields_of(text)
    except DefinitionError:
        return
    assert all(name.isidentifier() for name, _ in names)


@pytest.mark.parametrize(
    ("model", "params", "expected"),
    [
        ("SIMPLE_RADIAL", (50.0, 32.0, 24.0, 0.1), (50.0, 50.0, 31.5, 23.5, "0.1 0.0 0.0 0.0")),
        ("PINHOLE", (50.0, 51.0, 32.0, 24.0), (50.0, 51.0, 31.5, 23.5, "")),
        ("FULL_OPENCV", (5.0, 6.0, 3.0, 2.0, 1, 2, 3, 4, 5, 0, 0, 0), (5.0, 6.0, 2.5, 1.5, "1.0 2.0 3.0 4.0 5.0")),
    ],
)
def test_cameras_are_given_in_opencvs_convention(
    model: str, params: tuple[float, ...], expected: tuple[object, ...]
) -> None:
    values = opencv_camera(Camera(model, 64, 48, params))

    assert tuple(values[name] for name in ("fx", "fy", "cx", "cy", "distortion")) == expected


def test_other_camera_models_have_no_opencv_numbers() -> None:
    assert opencv_camera(Camera("FOV", 64, 48, (50.0, 50.0, 32.0, 24.0, 0.9))) == {}


@pytest.fixture
def folders(tmp_path: Path) -> tuple[Path, Path]:
    """Return a folder with a program and what it reads, and the definition's folder beside it."""
    system, study = tmp_path / "system", tmp_path / "study"
    for folder in (system, study):
        folder.mkdir()
    (system / "solver").write_text("#!/bin/sh\nexit 0\n")
    (system / "solver").chmod(0o755)
    (system / "base.yaml").write_text("a: 1\n")
    (system / "program.toml").write_text(
        'arguments = ["./solver", "{words}", "{settings_file}", "{output}"]\noutput = {association = "index"}\n'
        'settings_files = [{template = "base.yaml"}]\noptions = {x = {default = 2, key = "a"}}\n'
        'parameters = {words = {kind = "file"}}\n'
    )
    (study / "words.txt").write_text("some\n")
    return system, study


def test_relative_paths_start_from_the_study_and_from_the_definition_wherever_it_is_worked_on(
    folders: tuple[Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    system, study = folders
    settings = {"definition": "../system/program.toml", "words": "words.txt"}
    found = []

    for current in (study, system, tmp_path):
        monkeypatch.chdir(current)
        found.append(create(rooted(settings, study)))
    monkeypatch.chdir(study)
    as_before = create(settings)

    command = found[0].command
    assert command.parameters["words"] == study / "words.txt"
    assert command.definition.arguments[0] == str(study / ".." / "system" / "solver")
    assert command.definition.options["x"].default == 1
    assert {one.settings["identity"] for one in found} == {as_before.settings["identity"]}
    assert {one.settings["source"] for one in found} == {"../system/program.toml"}


def test_relative_settings_identify_what_they_did_before_they_could_start_from_a_folder(
    folders: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folders[0])

    pipeline = create({"arguments": ["./solver", "{output}"], "output": {"association": "index"}})

    assert pipeline.settings["identity"] == "eb0d13695cef74d959c7d3e3c84b735cb97e315da7c2095618f7e0ed48bdbcc9"
