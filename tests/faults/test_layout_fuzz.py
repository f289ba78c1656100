"""Data sets with one value of a file replaced or removed: whatever comes, they are read or refused in one sentence."""

import copy
import json
import math
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from gtf_tune.errors import GtfTuneError
from gtf_tune.sequence import Camera, inspect_sequence, load_sequence
from tests.sequence.miniatures import LAYOUTS

CASES = int(os.environ.get("GTF_TUNE_FUZZ_CASES", "300"))
SOAKED = "GTF_TUNE_FUZZ_CASES" in os.environ  # draws other cases each time
SLOWLY = settings(max_examples=CASES, deadline=None, derandomize=not SOAKED, suppress_health_check=list(HealthCheck))

GIVEN = Camera("PINHOLE", 64, 48, (40, 40, 32, 24))
LONGEST = 1200
HUGE = 10**330

NUMBERS = [0, -1, 1, 0.5, 1e-320, 1e6, 1e150, 1e308, -1e308, HUGE, -HUGE, math.nan, math.inf, -math.inf]
VALUES = [None, True, False, "", "text", "50", "5,0", "1_0", "\0", "٣", "..", "/", "a" * 600, [], {}, [[]], [1, "a"]]
TOKENS = [repr(number) if isinstance(number, float) else str(number) for number in NUMBERS]
TOKENS += [
    "",
    "text",
    "5,0",
    "1_0",
    "\0",
    "٣",
    "#",
    "-",
    "..",
    "/",
    "a" * 600,
    "9" * 330,
    "1 2",
    "2;3",
    '"1"',
    "\ufeff",
]
REMOVED = object()


def places(value: Any, here: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """Return the keys that lead to every node of a nested value."""
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [here, *(place for key, child in inner for place in places(child, (*here, key)))]


def with_node(value: Any, place: tuple[Any, ...], node: Any) -> Any:
    """Return a copy of a nested value with one node replaced or removed."""
    if not place:
        return {} if node is REMOVED else node
    changed = copy.deepcopy(value)
    parent = changed
    for key in place[:-1]:
        parent = parent[key]
    if node is REMOVED:
        del parent[place[-1]]
    else:
        parent[place[-1]] = node
    return changed


def damaged_json(draw: st.DrawFn, text: str) -> str:
    value = json.loads(text)
    return json.dumps(with_node(value, draw(st.sampled_from(places(value))), draw(NODES)))


def damaged_yaml(draw: st.DrawFn, text: str) -> str:
    value = yaml.safe_load(text)
    damaged = with_node(value, draw(st.sampled_from(places(value))), draw(NODES))
    return json.dumps(damaged) if draw(st.booleans()) else yaml.dump(damaged, Dumper=yaml.SafeDumper)


def damaged_table(draw: st.DrawFn, text: str) -> str:
    """Replace or remove a cell, or remove, repeat or move a line."""
    lines = text.splitlines()
    number = draw(st.integers(0, len(lines) - 1))
    separator = "," if "," in lines[number] else " "
    cells = lines[number].split(separator)
    what = draw(st.sampled_from(["replace", "replace", "replace", "remove", "add", "drop", "repeat", "move"]))
    column = draw(st.integers(0, len(cells) - 1))
    if what in ("replace", "remove", "add"):
        cells[column : column + (what != "add")] = [] if what == "remove" else [draw(st.sampled_from(TOKENS))]
        lines[number] = separator.join(cells)
    elif what == "repeat":
        lines.insert(number, lines[number])
    else:
        line = lines.pop(number)
        lines = lines if what == "drop" else [*lines, line]
    return "\n".join(lines) + "\n"


NODES = st.sampled_from(NUMBERS) | st.sampled_from(VALUES) | st.just(REMOVED)
DAMAGES: dict[str, Callable[[st.DrawFn, str], str]] = {".json": damaged_json, ".yaml": damaged_yaml}


def described(root: Path) -> list[Path]:
    """Return the files of a data set that are no images."""
    return sorted(path for path in root.rglob("*") if path.is_file() and path.suffix not in (".png", ".jpg"))


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the folder of a valid miniature of each layout."""
    folder = tmp_path_factory.mktemp("whole")
    for name, write in LAYOUTS.items():
        write(folder / name)
    return {name: folder / name for name in LAYOUTS}


@st.composite
def damages(draw: st.DrawFn, whole: dict[str, Path]) -> tuple[str, Path, str]:
    """Draw a layout, a file of it that is no image, and what stands in it instead."""
    name = draw(st.sampled_from(sorted(set(LAYOUTS) - {"folder"})))
    path = draw(st.sampled_from(described(whole[name])))
    damage = DAMAGES.get(path.suffix, damaged_table)
    return name, path.relative_to(whole[name]), damage(draw, path.read_text())


@SLOWLY
@given(data=st.data())
def test_a_damaged_data_set_is_read_or_refused_in_words(whole: dict[str, Path], data: st.DataObject) -> None:
    name, path, text = data.draw(damages(whole))
    target = whole[name] / path
    kept = target.read_bytes()
    try:
        target.write_text(text)
        _load(whole[name], name)
    finally:
        target.write_bytes(kept)


@SLOWLY
@given(data=st.data())
def test_a_damaged_binary_model_is_read_or_refused_in_words(whole: dict[str, Path], data: st.DataObject) -> None:
    model = whole["colmap"] / "sparse" / "0"
    binary = _binary_model()
    which = data.draw(st.sampled_from(sorted(binary)))
    position = data.draw(st.integers(0, len(binary[which]) - 1))
    tail = data.draw(st.binary(max_size=12))
    kept = binary[which][position:] if data.draw(st.booleans()) else binary[which][position + len(tail) :]
    try:
        for name, content in {**binary, which: binary[which][:position] + tail + kept}.items():
            (model / name).write_bytes(content)
        _load(whole["colmap"], "colmap")
    finally:
        for name in binary:
            (model / name).unlink()


def _binary_model() -> dict[str, bytes]:
    import struct

    cameras = struct.pack("<QIiQQ4d", 1, 1, 1, 64, 48, 50.0, 51.0, 32.0, 24.0)
    images = struct.pack("<Q", 5)
    for n in range(5):
        images += struct.pack("<I7dI", n + 1, 1, 0, 0, 0, -n, 0.1 * n**2, 0, 1) + f"{n}.png\0".encode()
        images += struct.pack("<Q", 0)
    return {"cameras.bin": cameras, "images.bin": images}


def _load(root: Path, layout: str) -> None:
    for camera in ("auto", GIVEN):
        try:
            inspect_sequence(load_sequence(root, layout=layout, camera=camera))
        except GtfTuneError as error:
            said = str(error)
            assert str(root) in said
            assert len(said) < LONGEST
            assert "\n" not in said


def test_the_miniatures_are_valid(whole: dict[str, Path]) -> None:
    for name, root in whole.items():
        assert load_sequence(root).layout == name


@pytest.mark.soak
@pytest.mark.parametrize("kind", ["damaged_data_set", "damaged_binary_model"])
def test_ten_thousand_damaged_data_sets(kind: str) -> None:
    environment = {**os.environ, "GTF_TUNE_FUZZ_CASES": "10000"}
    command = [sys.executable, "-m", "pytest", "-n0", "-q", "--durations=3", __file__, "-k", kind]
    assert subprocess.run(command, env=environment, check=False).returncode == 0
