"""What every executor promises; its test module has a subclass and a fixture ``executor`` of two jobs."""

import signal
from pathlib import Path

import pytest

from gtf_tune.execution import Executor, InlineExecutor, RunLimits
from gtf_tune.pipelines import Pipeline, RunOutcome
from gtf_tune.trajectory import to_bytes
from tests.execution.doubles import KilledFirst, Refusing, analytic, failing, request_of

LIMITS = RunLimits(timeout_s=60.0, memory_bytes=2**30)
WAIT_S = 60.0


def outcome_of(executor: Executor, pipeline: Pipeline, limits: RunLimits = LIMITS) -> RunOutcome:
    return executor.submit(request_of(pipeline), limits).result(WAIT_S)


class ExecutorContract:
    def test_runs_give_the_same_bits_as_in_this_process(self, executor: Executor) -> None:
        requests = [request_of(analytic(), index) for index in range(5)]
        inline = InlineExecutor()

        futures = [executor.submit(request, LIMITS) for request in requests]

        for request, future in zip(requests, futures, strict=True):
            here = inline.submit(request, LIMITS).result()
            assert to_bytes(future.result(WAIT_S).trajectory) == to_bytes(here.trajectory)

    def test_an_outcome_says_what_the_run_took_and_where(self, executor: Executor) -> None:
        outcome = outcome_of(executor, analytic())

        assert outcome.status == "ok"
        assert outcome.error == outcome.log == ""
        assert outcome.wall_s > 0
        assert outcome.peak_memory_bytes > 2**20
        assert outcome.host
        assert {"gtf_tune", "analytic", "python"} <= set(outcome.versions)

    @pytest.mark.parametrize(
        ("failure", "reason", "attempts"),
        [
            ("error", "the analytic pipeline was told to fail", 1),
            ("exception", "ZeroDivisionError: the analytic pipeline was told to break", 2),
            ("exit", "exit code 3", 2),
            ("abort", "SIGABRT", 2),
            ("segfault", "SIGSEGV", 2),
        ],
    )
    def test_a_run_that_fails_is_an_outcome_and_the_next_one_works(
        self, executor: Executor, failure: str, reason: str, attempts: int
    ) -> None:
        outcome = outcome_of(executor, failing(failure))

        assert outcome.status == "failed"
        assert reason in outcome.error
        assert (outcome.cause, outcome.attempts) == ("configuration", attempts)
        assert len(outcome.trajectory) == 0
        assert outcome_of(executor, analytic()).status == "ok"

    def test_a_run_that_hangs_ends_at_its_time_limit(self, executor: Executor) -> None:
        outcome = outcome_of(executor, failing("hang"), RunLimits(timeout_s=0.5, memory_bytes=2**30))

        assert outcome.status == "failed"
        assert "no result within 0.5 s" in outcome.error
        assert outcome.wall_s > 0.4  # the limit is counted in ticks of a quarter of a second
        assert outcome.host

    def test_a_run_that_eats_memory_ends_at_its_limit(self, executor: Executor) -> None:
        outcome = outcome_of(executor, failing("memory"), RunLimits(timeout_s=60.0, memory_bytes=2**28))

        assert outcome.status == "failed"
        assert "more than its memory limit of 0.25 GB" in outcome.error

    def test_only_the_end_of_what_a_run_prints_is_kept(self, executor: Executor) -> None:
        outcome = outcome_of(executor, failing("flood"))

        assert "told to print" in outcome.error
        assert 0 < len(outcome.log) <= 8192

    @pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGTERM])
    def test_a_run_that_was_killed_is_tried_again(self, executor: Executor, tmp_path: Path, by: int) -> None:
        outcome = outcome_of(executor, KilledFirst(tmp_path / "note", times=2, by=by))

        assert (outcome.status, outcome.attempts) == ("ok", 3)
        assert (tmp_path / "note").read_text() == "xxx"

    def test_a_run_that_is_always_killed_is_given_up(self, executor: Executor, tmp_path: Path) -> None:
        outcome = outcome_of(executor, KilledFirst(tmp_path / "note", times=99))

        assert outcome.status == "failed"
        assert "killed 3 times" in outcome.error
        assert outcome.cause == "configuration"

    def test_a_run_that_someone_ends_again_and_again_is_a_failure_of_the_machine(
        self, executor: Executor, tmp_path: Path
    ) -> None:
        outcome = outcome_of(executor, KilledFirst(tmp_path / "note", times=99, by=signal.SIGTERM))

        assert (outcome.status, outcome.cause) == ("failed", "machine")

    def test_a_run_that_dies_once_is_no_failure(self, executor: Executor, tmp_path: Path) -> None:
        outcome = outcome_of(executor, KilledFirst(tmp_path / "note", times=1, by=signal.SIGABRT))

        assert (outcome.status, outcome.attempts) == ("ok", 2)

    @pytest.mark.parametrize(("broken", "cause"), [(False, "configuration"), (True, "machine")])
    def test_a_failure_counts_where_what_is_known_to_work_works(
        self, executor: Executor, tmp_path: Path, broken: bool, cause: str
    ) -> None:
        pipeline = Refusing(tmp_path / "note", name=f"refusing, {broken}")
        if broken:
            pipeline.note.touch()
        known_good = request_of(pipeline, 0)

        futures = [executor.submit(request_of(pipeline, index), LIMITS, known_good) for index in (1, 2)]
        outcomes = [future.result(WAIT_S) for future in futures]

        assert [(outcome.status, outcome.cause) for outcome in outcomes] == [("failed", cause)] * 2
        assert ("cannot run what works elsewhere" in outcomes[0].error) == broken
