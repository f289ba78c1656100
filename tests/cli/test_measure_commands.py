"""The commands that compare systems and check options print what they found."""

import json
from pathlib import Path

from tests.cli.conftest import Cli

FLAGS = ("--noise-sigma", "5", "--jobs", "1")
FEW = ("-k", "1", "-K", "4", *FLAGS)


def test_compare_prints_a_table_of_80_columns_with_the_agreement(cli: Cli, room: Path) -> None:
    Path("good.json").write_text('{"filter": {"max_error": 0.002}}')
    Path("lossy.json").write_text('{"filter": {"max_error": 3e-5}}')

    said = cli("compare", "room", "analytic", "good.json", "lossy.json", "-p", "analytic", *FEW)

    assert said.code == 0, said.err
    table = said.out.splitlines()[:4]
    assert max(map(len, table)) <= 80
    assert "not comparable" in table[3]
    assert "the score orders 1 of 1 pairs as ground truth does" in said.out
    again = cli("compare", "room", "analytic", "good.json", "-p", "analytic", "--json", *FEW)
    assert again.err.count("reused") == 10
    assert json.loads(again.out)["systems"][1]["comparable"] is True


def test_check_prints_both_scores_and_the_verdict_and_needs_options(cli: Cli, room: Path) -> None:
    Path("lossy.json").write_text('{"filter": {"max_error": 3e-5}}')

    said = cli("check", "room", "--options", "lossy.json", "-p", "analytic", "-k", "1", *FLAGS)

    assert said.code == 0, said.err
    assert "The options do not hold here, after 4 noisy runs of each" in said.out
    nothing = cli("check", "room")
    assert (nothing.code, "give --options FILE.json or --like STUDY" in nothing.err) == (1, True)
