import json
import logging
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

distributed = pytest.importorskip("distributed", reason="the extra [dask] is not installed")

from gtf_tune.cli.parameters import make_executor  # noqa: E402
from gtf_tune.errors import DefinitionError, MachineError, SequenceError  # noqa: E402
from gtf_tune.execution import InlineExecutor, RunLimits  # noqa: E402
from gtf_tune.execution.dask.executor import DaskExecutor, elsewhere  # noqa: E402
from gtf_tune.execution.dask.worker import DATA_ROOT_VARIABLE, checked_here  # noqa: E402
from gtf_tune.sequence import load_sequence  # noqa: E402
from gtf_tune.store.database import create_database  # noqa: E402
from gtf_tune.store.maintenance.digest import study_digest  # noqa: E402
from gtf_tune.study.create import checked_definition, create_study  # noqa: E402
from gtf_tune.study.open_study import open_study  # noqa: E402
from gtf_tune.study.work.worker import StudyWorker  # noqa: E402
from tests.execution.doubles import Hanging, LosesItsHost, analytic, request_of  # noqa: E402
from tests.execution.executor_contract import LIMITS, WAIT_S, ExecutorContract  # noqa: E402
from tests.faults.disturbance import wait_until  # noqa: E402
from tests.study.conftest import definition_of, write_sequence  # noqa: E402


@pytest.fixture(scope="module")
def cluster() -> Iterator[object]:
    """Yield a cluster of two workers in processes of this machine."""
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0", memory_limit=0
    ) as local:
        yield local


@pytest.fixture(scope="module")
def executor(cluster: distributed.LocalCluster) -> Iterator[DaskExecutor]:
    with DaskExecutor(cluster.scheduler_address) as connected:
        yield connected


@pytest.fixture
def room(tmp_path: Path) -> Path:
    return write_sequence(tmp_path / "room", ground_truth=False)


class TestDaskExecutor(ExecutorContract):
    """Check the promises of every executor."""


def test_a_lost_worker_costs_its_runs_only(
    executor: DaskExecutor, cluster: distributed.LocalCluster, tmp_path: Path
) -> None:
    others = [executor.submit(request_of(analytic(), index), LIMITS) for index in range(4)]
    future = executor.submit(request_of(LosesItsHost(tmp_path / "note")), LIMITS)

    assert future.result(2 * WAIT_S).status == "ok"
    assert (tmp_path / "note").read_text() == "xx"
    assert {other.result(WAIT_S).status for other in others} == {"ok"}


def test_a_run_that_failed_is_sent_to_another_host_where_there_is_one() -> None:
    workers = ["tcp://10.0.0.1:4000", "tcp://10.0.0.1:4001", "tcp://10.0.0.2:4000"]

    assert elsewhere(workers, {"tcp://10.0.0.1:4000"}) == ["tcp://10.0.0.2:4000"]
    assert elsewhere(workers, {"tcp://10.0.0.1:4000", "tcp://10.0.0.2:4000"}) is None


def test_what_no_worker_has_begun_can_be_cancelled(executor: DaskExecutor, tmp_path: Path) -> None:
    limits = RunLimits(timeout_s=2.0, memory_bytes=2**30)
    futures = [executor.submit(request_of(Hanging(tmp_path / "pid"), index), limits) for index in range(12)]

    executor.cancel_waiting()

    begun = [future for future in futures if not future.cancelled()]
    assert len(begun) < len(futures)
    assert {future.result(WAIT_S).status for future in begun} <= {"failed"}


def test_a_scheduler_that_does_not_answer_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:

    monkeypatch.setattr("gtf_tune.execution.dask.executor._CONNECT_TIMEOUT_S", 0.2)
    with pytest.raises(DefinitionError, match=r"no Dask scheduler answers at tcp://127\.0\.0\.1:9"):
        make_executor(1, None, "dask://127.0.0.1:9")


def test_a_scheduler_that_is_killed_is_one_sentence(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    file = tmp_path / "scheduler.json"
    command = [sys.executable, "-m", "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0"]
    scheduler = subprocess.Popen([*command, "--no-dashboard", "--scheduler-file", str(file)], stderr=subprocess.DEVNULL)
    wait_until(lambda: file.exists() and file.stat().st_size)
    address = json.loads(file.read_text())["address"].replace("tcp://", "dask://")

    logging.getLogger("distributed.client").addHandler(caplog.handler)  # Dask's loggers have handlers of their own

    with make_executor(1, None, address) as executor:
        future = executor.submit(request_of(analytic()), LIMITS)
        scheduler.kill()
        scheduler.wait()
        with pytest.raises(MachineError, match=r"^the Dask scheduler at tcp://\S+ is gone; start it again"):
            future.result(WAIT_S)

    logging.getLogger("distributed.client").removeHandler(caplog.handler)
    # Other parts of Dask log what the cluster of this module does, in this process too.
    assert [record for record in caplog.records if record.name == "distributed.client"] == []


def test_an_address_of_another_kind_is_refused() -> None:
    with pytest.raises(DefinitionError, match=r"takes local or dask://HOST:PORT, not 'slurm'"):
        make_executor(1, None, "slurm")


def test_without_dask_the_command_to_install_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(DefinitionError, match=r"pip install 'gtf-tune\[dask\]'"):
        DaskExecutor("tcp://127.0.0.1:9")


def test_a_worker_finds_images_below_its_own_data_root(
    room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sequence = load_sequence(room)
    assert sequence.fingerprint
    (tmp_path / "elsewhere").mkdir()
    room.rename(tmp_path / "elsewhere" / "room")
    monkeypatch.setenv(DATA_ROOT_VARIABLE, str(tmp_path / "elsewhere"))

    assert checked_here(sequence).frames[0].path.is_relative_to(tmp_path / "elsewhere")


def test_images_that_a_list_names_outside_the_sequence_stay_where_they_are(
    room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (room / "rgb").rename(tmp_path / "shared")
    names = (room / "rgb.txt").read_text().replace(" rgb/", f" {tmp_path}/shared/")
    (room / "rgb.txt").write_text(names)
    sequence = load_sequence(room)
    monkeypatch.setenv(DATA_ROOT_VARIABLE, str(tmp_path / "elsewhere"))

    assert checked_here(sequence).frames[0].path.is_relative_to(tmp_path / "shared")


def test_a_worker_refuses_other_pixels(room: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = load_sequence(room)
    assert sequence.fingerprint
    frames = sorted((room / "rgb").glob("*.png"))
    frames[0].write_bytes(frames[1].read_bytes())

    with pytest.raises(SequenceError, match="has other pixels than the study's"):
        checked_here(sequence)


def test_a_study_on_a_cluster_finds_what_it_finds_here(executor: DaskExecutor, room: Path, tmp_path: Path) -> None:
    digests = []
    for runs_on in (InlineExecutor(), executor):
        database = create_database(f"{tmp_path}/{type(runs_on).__name__}.db")
        create_study(database, checked_definition(definition_of(room, search={"trials": 3}), "test"), room)
        assert StudyWorker(open_study(database, "small"), runs_on).work()
        digests.append(study_digest(database, "small"))
        database.close()

    assert digests[0] == digests[1]
