import json
from pathlib import Path

from tests.cli.conftest import Cli


def test_noise_recommends_a_sigma_with_its_table(cli: Cli, room: Path) -> None:
    said = cli("noise", "room", "-p", "analytic", "--runs", "4", "--jobs", "1")

    assert said.code == 0
    assert "recommended noise: sigma" in said.out
    assert max(map(len, said.out.splitlines())) <= 80


def test_noise_as_json_holds_every_level(cli: Cli, room: Path) -> None:
    found = json.loads(cli("noise", "room", "-p", "analytic", "--sigmas", "2,4", "--jobs", "1", "--json").out)

    assert [level["sigma"] for level in found["levels"]] == [2.0, 4.0]
    assert found["true_errors"]["sigmas"] == [0.0, 2.0, 4.0]
    assert sorted(found["true_errors"]["errors"]) == found["true_errors"]["errors"]
    assert found["true_errors"]["line"]["slope"] > 0
    assert found["recommended"] in (2.0, 4.0)


def test_a_ladder_that_does_not_rise_is_refused(cli: Cli, room: Path) -> None:
    said = cli("noise", "room", "-p", "analytic", "--sigmas", "4,2")

    assert said.code == 1
    assert "rising grey levels" in said.err


def test_noise_tells_what_it_measured_also_where_the_figure_cannot_be_written(cli: Cli, room: Path) -> None:
    said = cli("noise", "room", "-p", "analytic", "--sigmas", "2,4", "--jobs", "1", "--figure", "no/folder.html")

    assert (said.code, "cannot be written" in said.err) == (1, True)
    assert "recommended noise: sigma" in said.out


def test_noise_writes_its_curves_to_a_file(cli: Cli, room: Path) -> None:
    said = cli("noise", "room", "-p", "analytic", "--sigmas", "2,4", "--jobs", "1", "--figure", "noise.html")

    assert said.code == 0
    assert "wrote noise.html" in said.err
    assert "recommended sigma" in Path("noise.html").read_text(encoding="utf-8")
