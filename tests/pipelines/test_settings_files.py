"""Values are written into settings files, and not one other byte changes."""

import json
import tomllib
from pathlib import Path

import cv2
import pytest
from hypothesis import given
from hypothesis import strategies as st
from ruamel.yaml import YAML

from gtf_tune.errors import DefinitionError
from gtf_tune.pipelines.command.settings_files import FORMATS, SettingValue, format_of, write_values

OPENCV = """%YAML:1.0

# ORB
Camera.fx: 458.654   # pixels
Camera.type: "PinHole"
Tbc: !!opencv-matrix
   rows: 2
   cols: 2
   dt: f
   data: [1.0, 0.0,
          0.0, 1.0]
ORBextractor.nFeatures: 1000
Viewer.PointSize:2
"""

YAML_TEXT = """# base
use_calib: False
matching:
  lambda_init: 1e-8  # small
  list: [1, 2,
    3, 4]
  "quoted key": 'it''s'
  text: |
    radius: 99
  items:
    - radius: 98
      name: b
    - radius: 97
  same_level:
  - radius: 96
  radius: 3

tracking: {radius: 5}
"""

INI = "database_path=a.db\n[Mapper]\nmin_num_matches = 15 ; pairs\nratio: 0.5\n\n[SiftExtraction]\npeak=0.1\n"
JSON = '{\n  "a": {"b": 1.50, "c": [1, {"b": 2}]},\n  "d.e": "x",\t"f": {}\n}\n'
TOML = 'x = 1 # one\ntext = """\nx = 7\n"""\n[a.b]\nc = "s" # d\n"d.e" = 0.5\nlist = [\n  1,\n]\n[[t]]\nc = 9\n'

values = st.one_of(
    st.booleans(),
    st.integers(-(2**31), 2**31),
    st.floats(allow_nan=False, allow_infinity=False),
    st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Zl", "Zp"], exclude_characters="\ufeff")),
)


def test_opencv_reads_what_was_written(tmp_path: Path) -> None:
    written: dict[str, SettingValue] = {"ORBextractor.nFeatures": 1500, "Camera.fx": 1e-5, "Viewer.PointSize": 3.0}

    (tmp_path / "orb.yaml").write_text(write_values(OPENCV, "yaml", {**written, "Camera.type": "Rectified"}))

    storage = cv2.FileStorage(str(tmp_path / "orb.yaml"), cv2.FILE_STORAGE_READ)
    assert {key: storage.getNode(key).real() for key in written} == written
    assert storage.getNode("Camera.type").string() == "Rectified"
    assert storage.getNode("Tbc").mat().tolist() == [[1, 0], [0, 1]]
    storage.release()


def test_only_the_value_changes_in_an_opencv_file() -> None:
    edited = write_values(OPENCV, "yaml", {"Camera.fx": 500.0, "Tbc.rows": 3})

    expected = OPENCV.replace("458.654", "500.0").replace("rows: 2", "rows: 3")
    assert edited == expected


def test_opencv_has_numbers_for_booleans() -> None:
    assert "ORBextractor.nFeatures: 1\n" in write_values(OPENCV, "yaml", {"ORBextractor.nFeatures": True})


@pytest.mark.parametrize("line_end", ["\n", "\r\n"])
def test_nested_yaml_keeps_comments_order_and_line_ends(line_end: str) -> None:
    text = YAML_TEXT.replace("\n", line_end)

    edited = write_values(text, "yaml", {"matching.lambda_init": 1e-5, "matching.radius": 7, "use_calib": True})

    expected = text.replace("1e-8", "1.0e-05").replace("  radius: 3", "  radius: 7").replace("False", "true")
    assert edited == expected


@pytest.mark.parametrize("key", ["matching.list", "matching.text", "matching.items", "matching", "tracking"])
def test_what_is_no_single_yaml_value_is_left_alone(key: str) -> None:
    with pytest.raises(DefinitionError, match="does not hold a single value"):
        write_values(YAML_TEXT, "yaml", {key: 1})


def test_tags_and_anchors_are_neither_executed_nor_replaced() -> None:
    text = "a: !!python/object/apply:os.system ['true']\nb: &anchor 1\nc: *anchor\n"

    for key in "abc":
        with pytest.raises(DefinitionError, match="does not hold a single value"):
            write_values(text, "yaml", {key: 2})


@given(values)
def test_yaml_values_come_back_as_they_were(value: SettingValue) -> None:
    edited = write_values(YAML_TEXT, "yaml", {"matching.radius": value})

    loaded = YAML(typ="safe").load(edited)
    assert loaded["matching"].pop("radius") == value
    before = YAML(typ="safe").load(YAML_TEXT)
    del before["matching"]["radius"]
    assert loaded == before
    assert FORMATS["yaml"].values(edited)["matching.radius"] == value


@given(values)
def test_json_values_come_back_as_they_were(value: SettingValue) -> None:
    edited = write_values(JSON, "json", {"a.b": value})

    assert json.loads(edited)["a"]["b"] == value
    assert edited.endswith(JSON[JSON.index(', "c"') :])


@given(values)
def test_toml_values_come_back_as_they_were(value: SettingValue) -> None:
    edited = write_values(TOML, "toml", {"a.b.c": value, "x": value})

    assert tomllib.loads(edited) == {**tomllib.loads(TOML), "x": value, "a": {"b": _with(TOML, "c", value)}}
    assert "# one" in edited


def _with(text: str, key: str, value: SettingValue) -> dict[str, object]:
    return {**tomllib.loads(text)["a"]["b"], key: value}


def test_ini_values_change_in_place() -> None:
    edited = write_values(INI, "ini", {"database_path": "b.db", "Mapper.min_num_matches": 20, "Mapper.ratio": 0.25})

    assert edited == INI.replace("a.db", "b.db").replace("15 ;", "20 ;").replace("0.5", "0.25")


def test_missing_keys_are_named_with_the_nearest_ones() -> None:
    with pytest.raises(DefinitionError, match=r"'ORBextractor\.nFeature'.*'ORBextractor\.nFeatures'.*'Camera\.gx'"):
        write_values(OPENCV, "yaml", {"ORBextractor.nFeature": 1, "Camera.gx": 2})


@pytest.mark.parametrize(
    ("form", "text", "added", "line"),
    [
        ("yaml", OPENCV, "Camera.k3", "Camera.k3: 0.5\n"),
        ("yaml", YAML_TEXT, "matching.new.deep", "  radius: 3\n  new:\n    deep: 0.5\n"),
        ("yaml", YAML_TEXT, "other.new", "tracking: {radius: 5}\nother:\n  new: 0.5\n"),
        ("ini", INI, "Mapper.new", "ratio: 0.5\nnew=0.5\n\n"),
        ("ini", INI, "Other.new", "peak=0.1\n[Other]\nnew=0.5\n"),
        ("json", JSON, "a.n.m", '"a": {"n": {"m": 0.5}, "b": 1.50'),
        ("json", JSON, "f.n", '"f": {"n": 0.5}'),
        ("toml", TOML, "a.b.new", "[a.b]\nnew = 0.5\nc ="),
        ("toml", TOML, "n.m", "[n]\nm = 0.5\n"),
    ],
)
def test_missing_keys_are_added_where_they_belong_if_asked(form: str, text: str, added: str, line: str) -> None:
    edited = write_values(text, form, {added: 0.5}, add_missing=True)

    assert line in edited
    assert FORMATS[form].values(edited)[added] == 0.5


@pytest.mark.parametrize(("form", "text"), [("json", "{"), ("json", "[1]"), ("toml", "a = ")])
def test_damaged_files_are_refused(form: str, text: str) -> None:
    with pytest.raises(DefinitionError, match="settings file"):
        write_values(text, form, {"a": 1})


def test_toml_inside_texts_and_arrays_is_out_of_reach() -> None:
    with pytest.raises(DefinitionError, match=r"'a\.b\.list'"):
        write_values(TOML, "toml", {"a.b.list": 1})
    with pytest.raises(DefinitionError, match=r"no key 'text\.x'"):
        write_values(TOML, "toml", {"text.x": 1})


def test_a_key_that_comes_twice_is_refused() -> None:
    with pytest.raises(DefinitionError, match="'a' 2 times"):
        write_values("a: 1\nb: 2\na: 3\n", "yaml", {"a": 4})


def test_line_breaks_do_not_break_ini_files() -> None:
    with pytest.raises(DefinitionError, match="line break"):
        write_values(INI, "ini", {"database_path": "a\n[Mapper]"})


def test_the_suffix_tells_the_format() -> None:
    assert [format_of(Path(f"a{end}")) for end in (".yml", ".ini", ".JSON", ".toml")] == ["yaml", "ini", "json", "toml"]
    with pytest.raises(DefinitionError, match=r"not '\.txt'"):
        format_of(Path("a.txt"))


@given(st.text(), st.sampled_from(sorted(FORMATS)))
def test_any_text_is_edited_or_refused_but_never_breaks(text: str, form: str) -> None:
    try:
        edited = write_values(text, form, {"some.key": 1}, add_missing=True)
    except DefinitionError:
        return
    assert "some" in edited or "key" in edited


@pytest.mark.parametrize(
    ("form", "text"),
    [
        ("yaml", "some: {other: 1}\nlast: 2\n"),
        ("yaml", "some: 1\n"),
        ("yaml", "some:\n  - 1\nlast: 2\n"),
        ("json", '{"some": [1]}'),
        ("json", '{"some": null}'),
    ],
)
def test_a_key_is_not_added_where_it_would_hide_what_is_there(form: str, text: str) -> None:
    with pytest.raises(DefinitionError, match=r"'some.key' cannot be added to the settings file, where 'some'"):
        write_values(text, form, {"some.key": 1}, add_missing=True)


@pytest.mark.parametrize("text", ["a: one\n  and two\nb: 2\n", 'a: "one\n  and two"\nb: 2\n'])
def test_yaml_values_of_several_lines_are_left_alone(text: str) -> None:
    with pytest.raises(DefinitionError, match="'a' of the settings file does not hold a single value"):
        write_values(text, "yaml", {"a": "three"})
    assert write_values(text, "yaml", {"b": 3}) == text.replace("2", "3")
