"""Which trial to use, decided from what is known of a study."""

from dataclasses import replace
from typing import Any

import pytest

from gtf_tune.store.trials import Trial
from gtf_tune.study.outcome.confirm import best_candidates
from gtf_tune.study.outcome.evidence import Evidence, evidence_of
from gtf_tune.study.outcome.improvement import Improvement
from gtf_tune.study.outcome.recommendation import Recommendation, decide
from gtf_tune.study.outcome.verdict import Candidate, MeasuredNominal, Verdict, VerdictWord

IN_SEARCH = Improvement(0.27, 0.20, 0.33, 6)
ON_FRESH_NOISE = Improvement(0.12, 0.05, 0.18, 16)


def trial(number: int, value: float, *, feasible: bool = True, option: float | None = None) -> Trial:
    unused: dict[str, Any] = {
        "id": number + 1,
        "study_id": 1,
        "optuna_trial_id": number,
        "optuna_number": number,
        "attempts": 1,
        "owner": "",
        "host": "",
        "heartbeat_at": None,
        "gtf_ate": value,
        "standard_error": None,
        "ci_low": None,
        "ci_high": None,
        "coverage": 1.0,
        "collapsed_rate": 0.0,
        "clean_runs": 2,
        "noisy_runs": 6,
        "wall_s": 1.0,
        "started_at": 0.0,
        "finished_at": 1.0,
    }
    options = {"threshold": float(number) if option is None else option}
    message = "" if feasible else "a run registered 10% of the frames"
    return Trial(
        number=number, state="complete", options=options, value=value, feasible=feasible, message=message, **unused
    )


NOMINAL, SECOND, BEST = trial(0, 3.0), trial(1, 2.5), trial(2, 2.0)
BROKEN = trial(0, 1e6, feasible=False)


def candidate(of: Trial, *reasons: str, improvement: Improvement = ON_FRESH_NOISE) -> Candidate:
    return Candidate(of.number, of.options or {}, 2.0, improvement, 0.01, 0.02, not reasons, reasons, {})


def confirmed(word: VerdictWord, *candidates: Candidate, adopted: int | None = None) -> Verdict:
    nominal = MeasuredNominal(0, NOMINAL.options or {}, {}) if candidates else None
    return Verdict(word, adopted, candidates, nominal, 16)


def decision(*known: Trial, verdict: Verdict | None = None) -> Recommendation:
    return decide(evidence_of("GTF ATE", known, verdict), IN_SEARCH)


def number(found: Recommendation) -> int | None:
    return found.trial.number if found.trial else None


def test_the_best_trial_is_unconfirmed_without_a_confirmation() -> None:
    found = decision(NOMINAL, SECOND, BEST)

    assert (found.decision, number(found), found.step) == ("unconfirmed", 2, "confirm")
    assert found.sentences == (
        "GTF ATE -27.0 % (95 % interval -33.0 % to -20.0 %, 6 noisy runs) against nominal, in the search.",
        "These runs made it the best of 3 feasible trials, which flatters it.",
    )


LEAD = {"number": 1, "margin": 0.05}


@pytest.mark.parametrize(("other", "chosen"), [(2.4, 1), (2.37, 2), (3.1, 1)])
def test_the_leading_trial_is_chosen_unless_another_score_is_smaller_by_the_margin(other: float, chosen: int) -> None:
    found = decide(evidence_of("GTF ATE", [NOMINAL, SECOND, trial(2, other)], None, lead=LEAD), IN_SEARCH)

    assert (found.decision, number(found)) == ("unconfirmed", chosen)
    assert ("smaller by 5%" in found.text) == (chosen == 1)


@pytest.mark.parametrize("leader", [trial(1, 3.05), trial(1, 2.0, feasible=False)])
def test_a_leading_trial_that_is_not_better_than_nominal_leads_nothing(leader: Trial) -> None:
    found = decide(evidence_of("GTF ATE", [NOMINAL, leader, trial(2, 2.9)], None, lead=LEAD), IN_SEARCH)

    assert number(found) == 2


def test_a_confirmation_ranks_its_candidates_with_the_margin_of_the_leading_trial() -> None:
    known = [NOMINAL, trial(1, 2.5), trial(2, 2.4), trial(3, 2.3), trial(4, 2.2)]

    assert [one.number for one in best_candidates(known, NOMINAL, 3)] == [4, 3, 2]
    assert [one.number for one in best_candidates(known, NOMINAL, 3, LEAD)] == [4, 3, 1]


def test_an_interval_that_holds_zero_is_said_to_exclude_nothing() -> None:
    found = decide(evidence_of("GTF ATE", [NOMINAL, BEST], None), Improvement(0.1, -0.05, 0.2, 6))

    assert "The interval does not exclude that the two are equal." in found.sentences


def test_the_adopted_trial_is_the_best_though_another_has_a_smaller_score() -> None:
    verdict = confirmed("adopt", candidate(BEST, "worse on hall"), candidate(SECOND), adopted=1)

    found = decision(NOMINAL, SECOND, BEST, verdict=verdict)

    assert (found.decision, number(found), found.step) == ("adopt", 1, "export")
    assert found.improvement == ON_FRESH_NOISE
    assert found.sentences == (
        "GTF ATE -12.0 % (95 % interval -18.0 % to -5.0 %, 16 noisy runs) against nominal, on fresh noise.",
    )


def test_the_adopted_one_of_several_that_passed_is_said_to_be_the_surest() -> None:
    larger = Improvement(0.4, 0.01, 0.7, 16)
    verdict = confirmed("adopt", candidate(BEST, improvement=larger), candidate(SECOND), adopted=1)

    found = decision(NOMINAL, SECOND, BEST, verdict=verdict)

    assert found.sentences[-1] == "Of 2 candidates that passed, its improvement is the surest."


def test_a_kept_nominal_is_the_best_and_says_what_speaks_against_the_others() -> None:
    verdict = confirmed("keep nominal", candidate(BEST, "not significantly better than nominal"))

    found = decision(NOMINAL, BEST, verdict=verdict)

    assert (found.decision, number(found), found.step) == ("keep nominal", 0, "export")
    assert "Trial 2: GTF ATE -12.0 % (95 % interval -18.0 % to -5.0 %, 16 noisy runs); not significantly better" in (
        " ".join(found.sentences)
    )


@pytest.mark.parametrize("verdict", [confirmed("adopt", candidate(SECOND), adopted=1), confirmed("keep nominal")])
def test_a_trial_that_came_later_is_named_beside_what_the_confirmation_said(verdict: Verdict) -> None:
    found = decision(NOMINAL, SECOND, BEST, verdict=verdict)

    assert number(found) == (verdict.adopted or 0)
    assert found.sentences[-1].startswith("Trial 2, which that confirmation did not measure, has a smaller GTF ATE")
    assert found.step == "confirm"


def test_a_luckier_trial_of_options_that_were_measured_is_no_news() -> None:
    again = replace(BEST, number=7, value=1.5)
    verdict = confirmed("adopt", candidate(BEST), adopted=2)

    found = decision(NOMINAL, BEST, again, verdict=verdict)

    assert (number(found), found.evidence.newer, found.step) == (2, None, "export")


@pytest.mark.parametrize(
    ("nominal", "word", "because"),
    [
        (
            BROKEN,
            "keep nominal",
            "were infeasible in the search: a run registered 10% of the frames.",
        ),
        (BROKEN, "none", "On fresh noise the nominal options did not work"),
        (NOMINAL, "none", "On fresh noise the nominal options did not work"),
    ],
)
def test_nothing_is_recommended_where_nothing_passed_and_nominal_does_not_work(
    nominal: Trial, word: VerdictWord, because: str
) -> None:
    found = decision(nominal, BEST, verdict=confirmed(word, candidate(BEST, "not significantly better")))

    assert (found.decision, found.trial, found.step) == ("neither", None, "new study")
    assert because in found.text
    assert not found.improvement.is_known


def test_a_later_trial_is_looked_at_anew_where_the_confirmation_came_to_nothing() -> None:
    found = decision(BROKEN, SECOND, BEST, verdict=confirmed("none", candidate(SECOND, "cannot be compared")))

    assert (found.decision, number(found), found.step) == ("unconfirmed", 2, "confirm")


def test_an_adopted_trial_counts_though_nominal_failed_in_the_search() -> None:
    found = decision(BROKEN, BEST, verdict=confirmed("adopt", candidate(BEST), adopted=2))

    assert (found.decision, number(found)) == ("adopt", 2)


def test_without_a_nominal_that_works_there_is_nothing_to_compare_with() -> None:
    found = decision(BROKEN, BEST)

    assert (found.decision, number(found)) == ("unconfirmed", 2)
    assert found.sentences[0] == "The nominal options are infeasible, so there is nothing to compare its GTF ATE with."


@pytest.mark.parametrize("other", [trial(1, 3.5), trial(1, 2.0, option=0.0)])
def test_nominal_stays_where_no_other_options_are_better(other: Trial) -> None:
    found = decision(NOMINAL, other)

    assert (found.decision, number(found), found.step) == ("nothing better", 0, "extend")
    assert found.beside_nominal is None


def test_a_study_without_a_feasible_trial_recommends_nothing() -> None:
    found = decision(BROKEN, trial(1, 1e6, feasible=False))

    assert (found.decision, found.trial, found.step) == ("nothing feasible", None, "wait")
    assert found.text == (
        "No trial is feasible so far. None of 2 trials is feasible. "
        "The nominal options: a run registered 10% of the frames."
    )


def test_a_summary_and_the_whole_name_the_same_trial() -> None:
    found = decision(NOMINAL, BEST)

    assert found.summary()["recommended"] == found.as_json()["recommended"]["ordinal"] == 2
    assert found.summary()["headline"] == found.as_json()["headline"] == found.headline


def test_evidence_without_trials_is_no_error() -> None:
    assert decide(Evidence("GTF ATE", None, None)).decision == "nothing feasible"


DOUBT = ("The score says little on room: 67% of nominal's noisy runs diverged.",)


def doubtful(verdict: Verdict | None = None) -> Recommendation:
    return decide(evidence_of("GTF ATE", (NOMINAL, SECOND, BEST), verdict, DOUBT), IN_SEARCH)


def test_a_score_that_says_little_recommends_nominal_before_a_confirmation() -> None:
    found = doubtful()

    assert (found.decision, number(found), found.step) == ("says little", 0, "other noise")
    assert found.text == f"Keep the nominal options. {DOUBT[0]}"


def test_what_an_earlier_version_adopted_does_not_stand_where_the_score_says_little() -> None:
    found = doubtful(confirmed("adopt", candidate(BEST), adopted=2))

    assert (found.decision, number(found), found.sentences) == ("keep nominal", 0, DOUBT)


def test_fresh_runs_of_nominal_that_are_sound_remove_the_doubt_of_the_search() -> None:
    found = doubtful(replace(confirmed("adopt", candidate(BEST), adopted=2), doubts=()))

    assert (found.decision, number(found)) == ("adopt", 2)
