from pathlib import Path

import pytest

from gtf_tune.errors import DefinitionError, SequenceError
from gtf_tune.execution import InlineExecutor
from gtf_tune.execution.base import RunLimits
from gtf_tune.store import confirmations, runs, studies, trials
from gtf_tune.store.confirmations import Confirmation
from gtf_tune.store.database import Database
from gtf_tune.study.open_study import OpenStudy, open_study
from gtf_tune.study.outcome.confirm import ConfirmationPlan, confirm, plan_confirmation
from gtf_tune.study.outcome.improvement import pick
from gtf_tune.study.outcome.recommendation import recommend
from gtf_tune.study.runs.run_source import Interrupted, RunSlot, RunSource
from gtf_tune.study.runs.stop import STOP_NOW, StopRequest
from gtf_tune.study.work.callbacks import Silent
from tests.study.conftest import Runner, definition_of, write_sequence

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


def _confirm(database: Database, executor: InlineExecutor | None = None, **counts: int) -> Confirmation:
    study, plan = _plan(database, **counts)
    return confirm(study, plan, _source(database, executor or InlineExecutor(), StopRequest()))


def _source(database: Database, executor: InlineExecutor, stop: StopRequest) -> RunSource:
    return RunSource(database, executor, RunLimits(60, 2**30), stop, Silent())


def test_a_setting_that_is_truly_better_is_adopted(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))

    found = _confirm(database, top=1, noisy_runs=8)

    assert found.verdict == "adopt"
    (candidate,) = found.result["candidates"]
    assert candidate["options"] == {"filter.max_error": BETTER}
    assert 0 < candidate["low"] < candidate["improvement"] < candidate["high"]


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


def test_a_second_confirmation_draws_noise_of_its_own(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))

    first, second = (_confirm(database, top=1, noisy_runs=4) for _ in range(2))

    assert not set(first.definition["run_keys"]) & set(second.definition["run_keys"])


def test_an_interrupted_confirmation_goes_on_with_the_same_runs(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))
    study, plan = _plan(database, top=1, noisy_runs=4)
    stop = StopRequest()

    class StopAfterNominal(Silent):
        heard = 0

        def run_finished(self, slot: RunSlot, run: runs.StoredRun, *, reused: bool) -> None:
            self.heard += 1
            if self.heard == 6:
                stop.ask(STOP_NOW)

    source = RunSource(database, InlineExecutor(), RunLimits(60, 2**30), stop, StopAfterNominal())
    with pytest.raises(Interrupted):
        confirm(study, plan, source)
    assert not confirmations.of_study(database, study.record.id)
    rest = InlineExecutor()

    found = _confirm(database, rest, top=1, noisy_runs=4)

    assert len(rest.executed) == 6
    assert len(found.definition["run_keys"]) == 12


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

    assert found.verdict == "keep nominal"
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
    by_sequence = found.result["candidates"][0]["by_sequence"]
    assert by_sequence["other"]["holdout"]
    assert not by_sequence["room"]["holdout"]


def test_a_held_out_sequence_that_lies_elsewhere_is_asked_for_by_its_flag(
    room: Path, tmp_path: Path, database: Database, run_study: Runner
) -> None:
    other = write_sequence(tmp_path / "other", ground_truth=False, frames=9)
    both = [{"name": "room", "path": str(room)}, {"name": "other", "path": str(other), "holdout": True}]
    run_study(definition_of(room, sequences=both, **GRID))
    moved = other.rename(tmp_path / "moved")

    with pytest.raises(SequenceError, match=r"--sequence other=PATH"):
        _plan(database)
    study = open_study(database, "small", {"other": moved})
    assert "other" in plan_confirmation(study, {"other": moved}).sequences


def test_too_few_noisy_runs_are_refused(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))

    with pytest.raises(DefinitionError, match="at least 4 noisy runs"):
        _plan(database, noisy_runs=3)


def test_the_recommendation_follows_the_confirmation(room: Path, database: Database, run_study: Runner) -> None:
    run_study(definition_of(room, **GRID))
    study_id = studies.get(database, "small").id
    before = recommend(database, study_id, "small")

    _confirm(database, top=1, noisy_runs=8)

    after = recommend(database, study_id, "small")
    assert before.verdict == "unconfirmed"
    assert (after.verdict, after.trial.options) == ("adopt", {"filter.max_error": BETTER})


def test_a_candidate_that_is_not_confirmed_leaves_nominal_recommended(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))
    study_id = studies.get(database, "small").id
    best = recommend(database, study_id, "small").trial
    candidate = {"ordinal": best.number, "options": best.options, "verdict": "keep nominal"}

    confirmations.add(
        database, study_id, {}, {"verdict": "keep nominal", "adopted": None, "candidates": [candidate]}, "keep nominal"
    )

    assert recommend(database, study_id, "small").trial.number == 0


def test_a_nominal_that_does_not_work_is_never_recommended(room: Path, database: Database, run_study: Runner) -> None:
    # Some runs fail whatever the options are: with this seed nominal's do, and those of other settings do not.
    pipeline = {"settings": {"failure": "error", "failure_rate": 0.3, "collapse_rate": 0.0}}
    run_study(definition_of(room, **{**GRID, "pipeline": pipeline, "gtf": {"clean_runs": 1, "noisy_runs": 1}}))
    study_id = studies.get(database, "small").id
    best = recommend(database, study_id, "small").trial
    candidate = {"ordinal": best.number, "options": best.options, "verdict": "keep nominal"}
    result = {"verdict": "keep nominal", "adopted": None, "candidates": [candidate]}

    confirmations.add(database, study_id, {}, result, "keep nominal")

    found = recommend(database, study_id, "small")
    assert not trials.get(database, study_id, 0).feasible
    assert (found.verdict, found.trial.number) == ("unconfirmed", best.number)


def test_a_luckier_trial_of_a_setting_that_was_compared_is_confirmed_too(
    room: Path, database: Database, run_study: Runner
) -> None:
    repeated = {
        "space": {"filter.max_error": {"values": [0.01, WORSE]}},
        "gtf": {"noisy_runs": 4, "common_noise": False},
        "search": {"sampler": "random", "trials": 8},
    }
    run_study(definition_of(room, **{**GRID, **repeated}))
    study_id = studies.get(database, "small").id

    _confirm(database, top=1, noisy_runs=8)

    found, best = recommend(database, study_id, "small"), trials.best(database, study_id)
    assert best is not None
    assert best.number
    assert best.options == found.trial.options == {"filter.max_error": 0.01}
    assert (found.verdict, found.trial.number) == ("keep nominal", 0)
    assert pick(database, study_id).is_nominal


def test_a_better_trial_after_the_confirmation_is_unconfirmed(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))
    study_id = studies.get(database, "small").id
    worse = {"ordinal": 3, "options": trials.get(database, study_id, 3).options, "verdict": "adopt"}
    result = {"verdict": "adopt", "adopted": 3, "candidates": [worse]}

    confirmations.add(database, study_id, {}, result, "adopt")

    assert recommend(database, study_id, "small").verdict == "unconfirmed"


def test_deleting_a_study_deletes_the_runs_of_its_confirmations(
    room: Path, database: Database, run_study: Runner
) -> None:
    run_study(definition_of(room, **GRID))
    keys = _confirm(database, top=1, noisy_runs=4).definition["run_keys"]
    before = runs.find(database, keys)

    studies.delete_study(database, "small")

    assert len(before) == len(keys)
    assert runs.find(database, keys) == {}
