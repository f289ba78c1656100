"""Options that were tuned elsewhere are checked from Python as by the command."""

from pathlib import Path

import pytest

import gtf_tune as gtf
from gtf_tune.api import comparison
from gtf_tune.execution import InlineExecutor

SCORE = {"clean_runs": 1, "noise_sigma": 5.0}


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(comparison, "executor_here", lambda _: InlineExecutor())


def test_options_or_a_file_of_them_give_one_verdict(folder: Path) -> None:
    (folder / "lossy.json").write_text('{"filter": {"max_error": 3e-5}}')

    by_name = gtf.check("photos", {"filter.max_error": 3e-5}, pipeline="analytic", gtf=SCORE)
    by_file = gtf.check("photos", "lossy.json", pipeline="analytic", gtf=SCORE)

    assert by_name.outcome == by_file.outcome == "does not hold"
    assert by_name.noisy_runs == 4
    assert by_name.as_json() == by_file.as_json()


def test_a_check_without_options_is_one_sentence(folder: Path) -> None:
    with pytest.raises(gtf.GtfTuneError, match=r"^there are no options to check; give some, or the study"):
        gtf.check("photos", pipeline="analytic")


def test_an_unknown_option_is_named_before_a_run(folder: Path) -> None:
    with pytest.raises(gtf.GtfTuneError, match=r"filter\.max_err"):
        gtf.check("photos", {"filter.max_err": 1.0}, pipeline="analytic", gtf=SCORE)
