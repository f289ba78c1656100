import math
from pathlib import Path

import pytest

from benchmarks import page
from benchmarks.__main__ import BENCHMARKS
from benchmarks.bare_study import Step, define, search
from benchmarks.page import Result, render
from benchmarks.search_runs import CASES, arrival
from benchmarks.section import Aim, Section, as_text
from benchmarks.verdict_price import Stages

MACHINE = {
    "processor": "a processor, 2 cores",
    "memory": "4 GiB",
    "system": "Linux",
    "versions": "gtf-tune 0",
    "speed": "20 million additions a second in Python",
    "load before": "0.1",
}


def _result(*aims: Aim) -> Result:
    section = Section("Speed", "How fast.", ("way", "time"), (("ours", "1 s"), ("theirs", "2 s")), aims, "So it is.")
    return Result(section, MACHINE, "2026-01-01", full=True, took_s=3.0)


def test_the_page_has_every_figure_the_aims_and_the_machine() -> None:
    text = render({"speed": _result(Aim("twice as fast", "2 x", met=True))})

    assert "| ours | 1 s |" in text
    assert "| twice as fast | 2 x | met |" in text
    assert "a processor, 2 cores" in text
    assert "So it is." in text


def test_a_missed_aim_says_what_bounds_it() -> None:
    text = render({"speed": _result(Aim("ten times", "2 x", met=False, bound="Light is slow."))})

    assert "**missed**. Light is slow." in text
    assert "MISSED  ten times: 2 x Light is slow." in as_text(
        _result(Aim("ten times", "2 x", False, "Light is slow.")).section
    )


def test_results_that_were_stored_give_the_same_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "RESULTS", tmp_path / "results.json")
    monkeypatch.setattr(page, "PAGE", tmp_path / "performance.md")
    results = {"speed": _result(Aim("twice as fast", "2 x", met=True))}

    page.save(results)

    assert page.load() == results
    assert (tmp_path / "performance.md").read_text() == render(results)


def test_every_benchmark_has_a_name() -> None:
    assert {"metric", "noise", "cache", "overhead", "jobs", "search", "many-trials"} <= set(BENCHMARKS)


def test_a_search_has_arrived_when_it_stays_close() -> None:
    steps = [Step(8, 2.0), Step(16, 1.0), Step(24, 1.2), Step(32, 1.04), Step(40, 1.02)]

    assert arrival(steps, goal=1.0) == 32
    assert arrival(steps[:3], goal=1.0) == math.inf


def test_bounds_of_the_axes_hold_nominal_and_differ_between_seeds() -> None:
    for case in CASES:
        assert case.space(0) != case.space(1)
        assert case.best_on_grid(0) < 2e-3


def test_a_bare_study_spends_what_its_budget_allows() -> None:
    definition = define(CASES[0].space(3), {"noisy_runs": 3}, {"sampler": "refine", "seed": 3})

    steps = search(definition, 40)

    assert [step.runs for step in steps] == sorted(step.runs for step in steps)
    assert 30 < steps[-1].runs <= 40
    assert steps[-1].true_error < steps[0].true_error


def test_configurations_share_the_images_of_a_copy_and_its_verification() -> None:
    stages = Stages(front=8.0, middle=2.0, mapping=1.0)

    assert stages.price((1, 0), 1) == 1.0
    assert stages.price((2, 3), 5) == (4 * 8 + 5 * (2 + 5)) / 11
    assert stages.price((2, 3), 5, clean_images=False) == (3 * 8 + 5 * (2 + 5)) / 11
