from concurrent.futures import Future
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gtf_tune.errors import DefinitionError, SequenceError
from gtf_tune.execution import InlineExecutor
from gtf_tune.execution.base import RunLimits
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.store import confirmations, runs, studies, trials
from gtf_tune.store.database import Database
from gtf_tune.study.open_study import OpenStudy, open_study
from gtf_tune.study.outcome.confirm import MARGINS_KEY, ConfirmationPlan, confirm, plan_confirmation
from gtf_tune.study.outcome.recommendation import Recommendation
from gtf_tune.study.outcome.recommendation import recommend as recommend_for
from gtf_tune.study.outcome.verdict import Verdict
from gtf_tune.study.runs.run_source import Interrupted, RunSource
from gtf_tune.study.runs.stop import StopRequest
from tests.study.conftest import Runner, definition_of, write_sequence
from tests.study.stopping import StopAfter

BETTER, WORSE = 0.002, 0.05
GRID = {
    "pipeline": {"settings": {"collapse_rate": 0.0}},
    "space": {"filter.max_error": {"values": [0.01, BETTER, 0.008, WORSE]}},
    "gtf": {"noisy_runs": 8},
    "search": {"sampler": "grid"},
}


def _plan(database: Database, **counts: int) -> tuple[OpenStudy, ConfirmationPlan]:
    study = open_study(database, "small")
    return study, plan_confirmation(study, {}, **counts)


def _run_keys(database: Database) -> list[str]:
    """Return the keys of the runs of the last confirmation."""
    study_id = studies.get(database, "small").id
    keys: list[str] = confirmations.of_study(database, study_id)[-1].definition["run_keys"]
    return keys


def _confirm(database: Database, executor: InlineExecutor | None = None, **counts: int) -> Verdict:
    study, plan = _plan(database, **counts)
    return confirm(study, plan, _source(database, executor or InlineExecutor(), StopRequest()))


def _source(database: Database, executor: InlineExecutor, stop: StopRequest) -> RunSource:
    return RunSource(database, executor, RunLimits(60, 2**30), stop)


def test_a_setting_that_is_truly_better_is_adopted(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))

    found = _confirm(database, top=1, noisy_runs=8)

    assert found.word == "adopt"
    (candidate,) = found.candidates
    assert candidate.options == {"filter.max_error": BETTER}
    assert 0 < candidate.improvement.low < candidate.improvement.value < candidate.improvement.high


def test_a_study_asks_more_of_an_option_that_has_a_margin(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))
    study, plan = _plan(database, top=1, noisy_runs=8)
    study.record.resolved[MARGINS_KEY] = {"filter.max_error": 0.99}  # type: ignore[index]

    found = confirm(study, plan, _source(database, InlineExecutor(), StopRequest()))

    assert found.word == "keep nominal"
    assert "better by less than 99%" in found.candidates[0].reasons[0]


def test_the_runs_of_a_confirmation_share_no_noise_and_no_seed_with_the_search(
    room: Path, database: Database, run_study: Runner
) -> None:
    searched = run_study(definition_of(room, **GRID)).executed
    executor = InlineExecutor()

    _confirm(database, executor, top=1, noisy_runs=4)

    assert len(executor.executed) == 2 * (2 + 4)
    assert not {one.seed for one in searched} & {one.seed for one in executor.executed}
    noisy = [{one.noise_seed for one in some if one.kind == "noisy"} for some in (searched, executor.executed)]
    assert not noisy[0] & noisy[1]


def test_a_second_confirmation_draws_noise_of_its_own_where_it_is_asked_to(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))

    _confirm(database, top=1, noisy_runs=4)
    first = _run_keys(database)
    _confirm(database, top=1, noisy_runs=4, again=True)

    assert not set(first) & set(_run_keys(database))


def test_an_interrupted_confirmation_goes_on_with_the_same_runs(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))
    study = open_study(database, "small")
    (close,) = [one for one in trials.of_study(database, study.record.id) if one.options == {"filter.max_error": 0.008}]
    plan = plan_confirmation(study, {}, noisy_runs=8, chosen=[close])
    stopping = StopAfter(12)  # those of the first look, which decides nothing
    source = RunSource(database, InlineExecutor(), RunLimits(60, 2**30), stopping.stop, stopping)
    with pytest.raises(Interrupted):
        confirm(study, plan, source)
    assert not confirmations.of_study(database, study.record.id)
    rest = InlineExecutor()

    confirm(study, plan, _source(database, rest, StopRequest()))

    assert len(rest.executed) == 8
    assert len(_run_keys(database)) == 20


def test_it_ends_at_the_first_look_that_decides(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))
    executor = InlineExecutor()

    found = _confirm(database, executor, top=2, noisy_runs=16)

    assert found.word == "adopt"
    assert found.noisy_runs < 16
    assert len(executor.executed) == len(_run_keys(database)) < 3 * (2 + 16)


def test_a_candidate_that_is_worse_gets_no_runs_after_the_first_look(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))
    study = open_study(database, "small")
    known = trials.of_study(database, study.record.id)
    chosen = [one for one in known if one.options in ({"filter.max_error": WORSE}, {"filter.max_error": 0.008})]
    executor = InlineExecutor()

    plan = plan_confirmation(study, {}, noisy_runs=16, chosen=chosen)
    found = confirm(study, plan, _source(database, executor, StopRequest()))

    worse = next(one for one in found.candidates if one.options == {"filter.max_error": WORSE})
    assert worse.improvement.value < 0
    assert worse.improvement.instances == 4 < found.noisy_runs
    assert sum(one.options == {"filter.max_error": WORSE} for one in executor.executed) == 2 + 4


class _AnotherSolution(InlineExecutor):
    """Let the first clean run fall into another solution whatever the options are."""

    def submit(
        self, request: RunRequest, limits: RunLimits, known_good: RunRequest | None = None
    ) -> Future[RunOutcome]:
        outcome = super().submit(request, limits, known_good).result()
        if (request.kind, request.index) == ("clean", 0):
            positions = np.random.default_rng(0).normal(size=outcome.trajectory.positions.shape)
            outcome = replace(outcome, trajectory=replace(outcome.trajectory, positions=positions))
        found: Future[RunOutcome] = Future()
        found.set_result(outcome)
        return found


def test_a_clean_run_of_another_solution_is_set_aside_and_another_is_drawn(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))
    executor = _AnotherSolution()

    found = _confirm(database, executor, top=1, noisy_runs=8)

    assert found.word == "adopt"
    assert found.set_aside == (
        "1 of 3 clean runs on room fell into another solution under every configuration alike and was set aside",
    )
    assert sorted({one.index for one in executor.executed if one.kind == "clean"}) == [0, 1, 2]


def test_candidates_have_different_options_and_beat_nominal(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))

    _, plan = _plan(database, top=9)

    values = [one.options["filter.max_error"] for one in plan.candidates if one.options]
    assert values == [BETTER, 0.008]


def test_without_a_better_setting_nothing_is_run_and_nominal_kept(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, space={"filter.max_error": {"values": [0.01, WORSE]}}, search={"sampler": "grid"}))
    executor = InlineExecutor()

    found = _confirm(database, executor)

    assert found.word == "keep nominal"
    assert executor.executed == []


def test_a_held_out_sequence_is_run_only_at_confirmation(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    other = write_sequence(tmp_path / "other", ground_truth=False, frames=9)
    both = [{"name": "room", "path": str(room)}, {"name": "other", "path": str(other), "holdout": True}]
    searched = run_study(definition_of(room, sequences=both, **GRID)).executed
    executor = InlineExecutor()

    found = _confirm(database, executor, top=1, noisy_runs=4)

    assert {one.sequence.name for one in searched} == {"room"}
    assert {one.sequence.name for one in executor.executed} == {"room", "other"}
    by_sequence = found.candidates[0].by_sequence
    assert by_sequence["other"].is_holdout
    assert not by_sequence["room"].is_holdout


def test_a_held_out_sequence_that_lies_elsewhere_is_asked_for_by_its_flag(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    other = write_sequence(tmp_path / "other", ground_truth=False, frames=9)
    both = [{"name": "room", "path": str(room)}, {"name": "other", "path": str(other), "holdout": True}]
    run_study(definition_of(room, sequences=both, **GRID))
    moved = other.rename(tmp_path / "moved")

    with pytest.raises(SequenceError, match=r"sequence 'other' is not at .*; say where it lies"):
        _plan(database)
    study = open_study(database, "small", {"other": moved})
    assert "other" in plan_confirmation(study, {"other": moved}).sequences


def test_too_few_noisy_runs_are_refused(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))

    with pytest.raises(DefinitionError, match="at least 4 noisy runs"):
        _plan(database, noisy_runs=3)


def recommend(database: Database) -> Recommendation:
    return recommend_for(database, studies.get(database, "small"))


def test_the_recommendation_follows_the_confirmation(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))
    before = recommend(database)

    verdict = _confirm(database, top=1, noisy_runs=8)

    after = recommend(database)
    assert before.decision == "unconfirmed"
    assert after.decision == "adopt"
    assert after.trial is not None
    assert after.trial.options == {"filter.max_error": BETTER}
    assert after.improvement == verdict.candidates[0].improvement


def test_a_luckier_trial_of_a_setting_that_was_compared_is_confirmed_too(
    room: Path, database: Database, run_study: Runner
) -> None:
    repeated = {
        "space": {"filter.max_error": {"values": [0.01, WORSE]}},
        "gtf": {"noisy_runs": 4, "common_noise": False},
        "search": {"sampler": "random", "trials": 8},
    }
    run_study(definition_of(room, **{**GRID, **repeated}))
    best = trials.best(database, studies.get(database, "small").id)
    before = recommend(database)

    _confirm(database, top=1, noisy_runs=8)

    after = recommend(database)
    assert best is not None
    assert best.number
    assert best.options == {"filter.max_error": 0.01}
    assert (before.decision, after.decision) == ("nothing better", "keep nominal")
    assert [found.trial.number for found in (before, after) if found.trial] == [0, 0]
    assert after.evidence.newer is None


def test_deleting_a_study_deletes_the_runs_of_its_confirmations(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))
    _confirm(database, top=1, noisy_runs=4)
    keys = _run_keys(database)
    before = runs.find(database, keys)

    studies.delete_study(database, "small")

    assert len(before) == len(keys)
    assert runs.find(database, keys) == {}


def test_a_baseline_is_confirmed_beside_the_best_and_may_be_adopted(
    room: Path, database: Database, run_study: Runner
) -> None:
    # The baseline's option is not searched, and the only trial of the search is worse than nominal.
    search = {"sampler": "grid", "baselines": {"the manual's": {"filter.max_error": BETTER}}}
    space = {"robust.scale": {"values": [1.0, 900.0]}}
    run_study(definition_of(room, **{**GRID, "space": space, "search": search}))

    found = _confirm(database, noisy_runs=8)
    recommended = recommend_for(database, studies.get(database, "small"))

    assert (found.word, [candidate.baseline for candidate in found.candidates]) == ("adopt", ["the manual's"])
    assert recommended.headline == "Adopt the options of the manual's"
    assert recommended.trial is not None
    assert recommended.trial.options == {"robust.scale": 1.0, "filter.max_error": BETTER}
    assert recommended.step == "export"


def test_the_verdict_says_what_became_of_a_baseline_too(room: Path, database: Database, run_study: Runner) -> None:
    baselines = {"the manual's": {"filter.max_error": WORSE}}
    run_study(definition_of(room, **{**GRID, "search": {"sampler": "grid", "baselines": baselines}}))

    found = _confirm(database, top=1, noisy_runs=8)
    recommended = recommend_for(database, studies.get(database, "small"))

    assert found.word == "adopt"
    assert "The manual's: GTF ATE +" in recommended.text
    assert "worse on room" in recommended.text


def test_a_chosen_trial_is_confirmed_instead_of_the_best(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))
    study = open_study(database, "small")
    other = next(
        one for one in trials.of_study(database, study.record.id) if one.options == {"filter.max_error": 0.008}
    )

    plan = plan_confirmation(study, {}, noisy_runs=8, chosen=[other])

    assert [trial.number for _, trial in plan.compared] == [other.number]
