import math
from collections.abc import Callable
from dataclasses import replace

import pytest

from gtf_tune.report.build import read_configurations
from gtf_tune.report.panels.verdict import verdict_headline, verdict_sentences
from gtf_tune.report.study_data import StudyData, read_search, read_study
from gtf_tune.report.verdict import compared_trials, study_verdict
from gtf_tune.store.database import Database
from gtf_tune.study.outcome.verdicts import NO_VERDICT

Confirm = Callable[[Database, str], None]


def test_the_best_trial_is_unconfirmed_without_a_confirmation(data: StudyData) -> None:
    verdict = study_verdict(data)

    assert (verdict.kind, verdict.number) == ("unconfirmed", 3)
    assert {change.option: (change.nominal, change.chosen) for change in verdict.changes} == {
        "filter.max_error": (0.01, 0.002),
        "robust.kernel": ("huber", "cauchy"),
    }


def test_an_unconfirmed_improvement_is_paired_by_noise_and_said_to_be_flattering(data: StudyData) -> None:
    verdict = study_verdict(data)

    assert verdict.improvement.low < verdict.improvement.value < verdict.improvement.high
    assert verdict.improvement.value == pytest.approx(1 - verdict.ratio, abs=0.05)
    assert "flatters" in verdict_sentences(data, verdict)[0]
    assert "gtf-tune study confirm synthetic" in verdict_sentences(data, verdict)[0]


def test_ground_truth_is_mentioned_as_something_that_the_search_never_saw(data: StudyData) -> None:
    verdict = study_verdict(data)

    assert 0 < verdict.ground_truth < 1
    assert any("never saw" in sentence for sentence in verdict_sentences(data, verdict))


def test_a_confirmed_candidate_is_to_be_adopted(own_database: Database, confirm_study: Confirm) -> None:
    confirm_study(own_database, "adopt")

    verdict = study_verdict(read_study(own_database, "synthetic"))

    assert (verdict.kind, verdict.number) == ("adopt", 3)
    assert verdict.improvement.value == 0.31
    assert verdict_headline(verdict) == "Adopt the options of trial 3"


def test_the_adopted_trial_is_drawn_beside_nominal_though_another_was_the_best_of_the_search(
    own_database: Database, confirm_study: Confirm
) -> None:
    confirm_study(own_database, "adopt")
    data = read_study(own_database, "synthetic")
    (found,) = data.confirmations
    (best,) = found.result["candidates"]
    both = {"candidates": [best, {**best, "ordinal": 8}], "adopted": 8}
    data = replace(data, confirmations=(replace(found, result={**found.result, **both}),))

    settings = read_configurations(own_database, data)["walk"]

    assert verdict_headline(study_verdict(data)) == "Adopt the options of trial 8"
    assert compared_trials(data) == [("nominal", 0), ("recommended", 8)]
    assert [one.title for one in settings] == ["nominal (trial 0)", "recommended (trial 8)"]


def test_the_best_trial_is_drawn_beside_nominal_until_one_is_adopted(data: StudyData) -> None:
    assert compared_trials(data) == [("nominal", 0), ("best", 3)]


def test_nominal_is_kept_where_no_candidate_was_confirmed(own_database: Database, confirm_study: Confirm) -> None:
    confirm_study(own_database, "keep nominal")

    verdict = study_verdict(read_study(own_database, "synthetic"))

    assert (verdict.kind, verdict.number) == ("keep", 0)
    assert verdict.candidates[0].reasons == ("not significantly better than nominal",)


def test_a_kept_nominal_is_not_said_to_be_unbeaten_where_candidates_were_better_but_fragile(
    own_database: Database, confirm_study: Confirm
) -> None:
    confirm_study(own_database, "keep nominal")
    data = read_study(own_database, "synthetic")

    sentence = verdict_sentences(data, study_verdict(data))[0]

    assert "none of 1 candidate passed every test" in sentence
    assert "beat" not in sentence


def test_a_kept_nominal_that_had_no_rival_was_not_run_again(own_database: Database, confirm_study: Confirm) -> None:
    confirm_study(own_database, "keep nominal")
    data = read_study(own_database, "synthetic")
    alone = replace(data.confirmations[0], result={"candidates": [], "adopted": None})
    data = replace(data, confirmations=(alone,), trials=tuple(one for one in data.trials if one.number != 3))
    best = replace(data, trials=tuple(replace(one, value=0.0) if not one.number else one for one in data.trials))

    verdict = study_verdict(best)

    assert verdict.kind == "keep"
    assert "nothing to confirm" in verdict_sentences(best, verdict)[0]


def test_a_nominal_that_does_not_work_is_never_kept(own_database: Database, confirm_study: Confirm) -> None:
    confirm_study(own_database, "keep nominal")
    data = read_study(own_database, "synthetic")
    broken = [replace(one, feasible=False) if one.number == 0 else one for one in data.trials]

    data = replace(data, trials=tuple(broken))
    verdict = study_verdict(data)

    assert (verdict.kind, verdict.number) == ("neither", 3)
    assert math.isnan(verdict.improvement.value)
    assert verdict.candidates
    assert "the nominal options were infeasible in the search" in verdict_sentences(data, verdict)[0]


def test_a_confirmation_in_which_nominal_did_not_work_is_not_asked_for_again(
    own_database: Database, confirm_study: Confirm
) -> None:
    confirm_study(own_database, NO_VERDICT)
    data = read_study(own_database, "synthetic")

    verdict = study_verdict(data)

    assert verdict.kind == "neither"
    assert "recommended" in verdict_headline(verdict)
    assert "did not work" in verdict_sentences(data, verdict)[0]
    assert not any("gtf-tune study confirm" in sentence for sentence in verdict_sentences(data, verdict))


def test_a_confirmation_says_nothing_about_a_better_trial_that_came_later(
    own_database: Database, confirm_study: Confirm
) -> None:
    confirm_study(own_database, "adopt")
    data = read_study(own_database, "synthetic")
    later = [replace(one, value=1e-6) if one.number == 8 else one for one in data.trials]

    verdict = study_verdict(replace(data, trials=tuple(later)))

    assert (verdict.kind, verdict.number) == ("unconfirmed", 8)


def test_nominal_stays_where_nothing_is_better(data: StudyData) -> None:
    worse = tuple(one for one in data.trials if one.number in (0, 1))

    verdict = study_verdict(replace(data, trials=worse))

    assert (verdict.kind, verdict.number) == ("none", 0)
    assert verdict_headline(verdict) == "Keep the nominal options so far"


def test_a_study_without_a_feasible_trial_has_no_verdict(database: Database) -> None:
    data = read_search(database, "empty")

    verdict = study_verdict(data)

    assert (verdict.kind, verdict.number) == ("none", None)
    assert verdict_sentences(data, verdict) == ["None of 0 trials is feasible and complete so far."]


def test_a_pick_at_the_end_of_its_range_is_a_reason_to_widen_it(data: StudyData) -> None:
    edge = [replace(one, options={**(one.options or {}), "filter.max_error": 1e-5}) for one in data.trials]

    verdict = study_verdict(replace(data, trials=tuple(edge)))

    assert verdict.at_an_edge == ("filter.max_error",)
    assert any("wider range" in sentence for sentence in verdict_sentences(data, verdict))
