"""Half a page says how often picks improve here and in the paper, and what each reason is worth."""

from dataclasses import replace
from pathlib import Path

from experiments.ablation import WITHOUT_EFFECT, WITHOUT_SUCCESSOR, pairs
from experiments.findings import Findings
from experiments.holds import holds_part
from experiments.plan import OPTIONS, Experiment
from experiments.settings import Outcome
from experiments.text import ABLATION
from tests.experiments.test_experiment_outcomes import setting


def grid(sequence: str, option: str, true_ates: dict[float, float], sigma: float = 5.0) -> Outcome:
    """Return a grid whose scores follow the true errors, nominal first."""
    settings = tuple(
        replace(setting(number, true_ate), value=value) for number, (value, true_ate) in enumerate(true_ates.items())
    )
    return Outcome(Experiment(sequence, OPTIONS[option], sigma), settings, settings[0], "keep nominal")


HUBER = {1.0: 4.0, 0.1: 2.0, 0.2: 1.0}
USUAL = [grid("room", "huber", HUBER), grid("hut", "ba", {0.01: 1.0, 0.1: 3.0})]
WEAKER = [grid("room", "huber", HUBER, 0.5)]


def found(outcomes: list[Outcome]) -> str:
    return holds_part(Findings(outcomes, [], WEAKER, [], [], [], [], []))


def test_the_paper_and_the_measured_grids_are_counted_alike() -> None:
    text = found(USUAL)

    assert "14 of 15 cells improve, by 26 % of the 32 %" in text
    assert "1 of 2 improve and 0 are worse, with a mean change of the true ATE of -37.5% of -37.5%" in text
    assert "which may keep nominal: 0 of 2 improve and 0 are worse" in text
    assert "| room | - | -75.0% (-75.0%) | - | - | - | 1 of 1 |" in text


def test_the_baseline_is_split_into_the_papers_value_and_what_lies_beyond() -> None:
    baseline = next(line for line in found(USUAL).splitlines() if "Baseline" in line)

    assert "0.1 alone changes the true ATE by -50.0%, the picks by -75.0%" in baseline
    assert "the picks improve 1 of 1, by -50.0% on average" in baseline


def test_noise_is_compared_on_the_same_grids_and_what_was_not_tested_is_said() -> None:
    text = found(USUAL)

    assert "The same 1 grids under two levels of noise. 5 grey levels: 1 of 1 improve" in text
    assert "0.5 grey levels: 1 of 1 improve" in text
    assert "**Frames, colour.** Not tested" in text


def test_the_page_of_results_begins_with_it() -> None:
    page = (Path(__file__).parents[2] / "docs" / "results-appendix.md").read_text()

    assert "## Does it hold?\n\nIn the paper's table 14 of 15 cells improve" in page[:300]


def test_each_of_the_papers_26_options_is_swept_idle_or_gone() -> None:
    swept = len(pairs()) + len(OPTIONS)

    assert (swept, len(WITHOUT_EFFECT), len(WITHOUT_SUCCESSOR)) == (19, 4, 3)
    assert "Of the paper's 26 options 3 have no successor in COLMAP 4" in ABLATION
