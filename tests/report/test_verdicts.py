from collections.abc import Callable
from dataclasses import replace

from gtf_tune.report.build import read_configurations
from gtf_tune.report.panels.verdict import compared_trials, verdict_facts, verdict_sentences
from gtf_tune.report.study_data import StudyData, read_search, read_study
from gtf_tune.store.database import Database
from gtf_tune.study.outcome.verdict import NO_VERDICT

Confirm = Callable[[Database, str], None]


def sentences(data: StudyData) -> str:
    return " ".join(verdict_sentences(data, verdict_facts(data)))


def test_the_recommended_options_stand_beside_nominal(data: StudyData) -> None:
    facts = verdict_facts(data)

    assert facts.recommendation.headline == "Trial 3 is the best so far; not confirmed yet"
    assert {change.option: (change.nominal, change.chosen) for change in facts.changes} == {
        "filter.max_error": (0.01, 0.002),
        "robust.kernel": ("huber", "cauchy"),
    }


def test_an_unconfirmed_improvement_is_paired_by_noise_and_said_to_be_flattering(data: StudyData) -> None:
    improvement = data.recommendation.improvement

    assert improvement.low < improvement.value < improvement.high
    assert f"GTF ATE {improvement.change} (95 % interval {improvement.bounds}, 4 noisy runs)" in sentences(data)
    assert "flatters" in sentences(data)
    assert "gtf-tune study confirm synthetic" in sentences(data)


def test_ground_truth_is_mentioned_as_something_that_the_search_never_saw(data: StudyData) -> None:
    facts = verdict_facts(data)

    assert -1 < facts.ground_truth < 0
    change = f"{100 * facts.ground_truth:+.1f} %"
    assert f"Ground-truth ATE {change} against nominal; the search never saw it." in sentences(data)


def test_a_confirmed_candidate_is_to_be_adopted(own_database: Database, confirm_study: Confirm) -> None:
    confirm_study(own_database, "adopt")

    found = read_study(own_database, "synthetic").recommendation

    assert (found.decision, found.trial and found.trial.number) == ("adopt", 3)
    assert found.improvement.value == 0.31
    assert found.headline == "Adopt the options of trial 3"


def test_the_adopted_trial_is_drawn_beside_nominal_though_another_was_the_best_of_the_search(
    own_database: Database, confirm_study: Confirm
) -> None:
    confirm_study(own_database, "adopt")
    data = read_study(own_database, "synthetic")
    (found,) = data.confirmations
    (best,) = found.result["candidates"]
    both = {"candidates": [best, {**best, "ordinal": 8}], "adopted": 8}
    data = replace(data, confirmations=(replace(found, result={**found.result, **both}),))

    configurations = read_configurations(own_database, data)["walk"]

    assert data.recommendation.headline == "Adopt the options of trial 8"
    assert compared_trials(data) == [("nominal", 0), ("recommended", 8)]
    assert [one.title for one in configurations] == ["nominal (trial 0)", "recommended (trial 8)"]


def test_the_best_trial_is_drawn_beside_nominal_until_one_is_adopted(data: StudyData) -> None:
    assert compared_trials(data) == [("nominal", 0), ("best", 3)]


def test_a_trial_that_was_turned_down_is_drawn_by_its_score(own_database: Database, confirm_study: Confirm) -> None:
    confirm_study(own_database, "keep nominal")

    assert compared_trials(read_study(own_database, "synthetic")) == [("nominal", 0), ("lowest score", 3)]


def test_a_kept_nominal_is_not_said_to_be_unbeaten_where_candidates_were_better_but_fragile(
    own_database: Database, confirm_study: Confirm
) -> None:
    confirm_study(own_database, "keep nominal")
    data = read_study(own_database, "synthetic")

    assert data.recommendation.decision == "keep nominal"
    assert "the only candidate did not pass every test" in sentences(data)
    assert "not significantly better than nominal" in sentences(data)
    assert "smaller" not in sentences(data)


def test_a_kept_nominal_that_had_no_rival_was_not_run_again(own_database: Database, confirm_study: Confirm) -> None:
    confirm_study(own_database, "keep nominal")
    data = read_study(own_database, "synthetic")
    alone = replace(data.confirmations[0], result={"candidates": [], "adopted": None})
    known = tuple(replace(one, value=0.0) if not one.number else one for one in data.trials if one.number != 3)

    data = replace(data, confirmations=(alone,), trials=known)

    assert data.recommendation.decision == "keep nominal"
    assert "nothing to confirm" in sentences(data)


def test_a_nominal_that_does_not_work_is_never_kept(own_database: Database, confirm_study: Confirm) -> None:
    confirm_study(own_database, "keep nominal")
    data = read_study(own_database, "synthetic")
    broken = [replace(one, feasible=False) if one.number == 0 else one for one in data.trials]

    data = replace(data, trials=tuple(broken))
    facts = verdict_facts(data)

    assert (facts.recommendation.decision, facts.recommendation.trial, facts.changes) == ("neither", None, ())
    assert not facts.recommendation.improvement.is_known
    assert "The nominal options were infeasible in the search" in sentences(data)
    assert "create a study whose nominal options work" in sentences(data)


def test_a_confirmation_in_which_nominal_did_not_work_is_not_asked_for_again(
    own_database: Database, confirm_study: Confirm
) -> None:
    confirm_study(own_database, NO_VERDICT)
    data = read_study(own_database, "synthetic")

    assert data.recommendation.decision == "neither"
    assert "did not work" in sentences(data)
    assert "gtf-tune study confirm" not in sentences(data)


def test_a_better_trial_that_came_later_is_named_beside_the_adopted_one(
    own_database: Database, confirm_study: Confirm
) -> None:
    confirm_study(own_database, "adopt")
    data = read_study(own_database, "synthetic")

    data = replace(data, trials=tuple(replace(one, value=1e-6) if one.number == 8 else one for one in data.trials))

    assert data.recommendation.headline == "Adopt the options of trial 3"
    assert "Trial 8, which that confirmation did not measure, has a smaller GTF ATE" in sentences(data)
    assert "gtf-tune study confirm synthetic" in sentences(data)


def test_nominal_stays_where_nothing_is_better(data: StudyData) -> None:
    found = replace(data, trials=tuple(one for one in data.trials if one.number in (0, 1)))

    assert found.recommendation.decision == "nothing better"
    assert found.recommendation.headline == "Keep the nominal options so far"
    assert compared_trials(found) == [("nominal", 0)]


def test_a_study_without_a_feasible_trial_recommends_nothing(database: Database) -> None:
    data = read_search(database, "empty")

    assert (data.recommendation.decision, data.recommendation.trial) == ("nothing feasible", None)
    assert sentences(data) == "No trial has ended, so nothing was compared."


def test_a_pick_at_the_end_of_its_range_is_a_reason_to_widen_it(data: StudyData) -> None:
    edge = [replace(one, options={**(one.options or {}), "filter.max_error": 1e-5}) for one in data.trials[1:]]

    found = replace(data, trials=(data.trials[0], *edge))

    assert verdict_facts(found).at_an_edge == ("filter.max_error",)
    assert "wider range" in sentences(found)
