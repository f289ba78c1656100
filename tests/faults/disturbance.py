"""Run studies in processes of their own, kill them, and check that nothing is lost, repeated or left running."""

import ctypes
import os
import socket
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from multiprocessing import get_context
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

import psutil

from gtf_tune.execution import Executor, InlineExecutor, LocalExecutor, StageCache
from gtf_tune.store import runs, studies, trials
from gtf_tune.store.database import Database, create_database, open_database, wait_for_database
from gtf_tune.store.maintenance.digest import study_digest
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.runs.stop import StopRequest, signals_to
from gtf_tune.study.work.server import WorkerLoop, WorkerRules
from tests.faults import counted

NAME = "disturbed"
PATIENCE_S = 120.0
_WORK_PATIENCE_S = 1800.0
_CLONE_NEWNET = 0x40000000
_CLONE_NEWUTS = 0x04000000


def definition(room: Path, **sections: Any) -> dict[str, Any]:
    """Return a small study; trials follow from their number alone, so that any number of workers makes the same."""
    data: dict[str, Any] = {
        "name": NAME,
        "pipeline": {"name": "counted"},
        "sequences": [{"name": "room", "path": str(room)}],
        "space": {"filter.max_error": {"low": 1e-3, "high": 0.1, "log": True}},
        "gtf": {"clean_runs": 1, "noisy_runs": 3, "noise_sigma": 5.0},
        "search": {"sampler": "random", "trials": 8},
    }
    return {
        name: {**value, **sections.get(name, {})} if isinstance(value, dict) else value for name, value in data.items()
    }


@dataclass(frozen=True)
class WorkerPlan:
    """Say how a worker process works: ``jobs`` 0 runs in the process itself, ``namespace`` names its network."""

    storage: str
    log: Path
    pause_s: float = 0.02
    jobs: int = 0
    cache: Path | None = None
    beat_s: float = 0.2
    grace_s: float = 30.0
    namespace: str = ""


def work(plan: WorkerPlan, site: str) -> None:
    """Serve the storage until nothing is left to do: the body of a worker process."""
    _prepare(plan, site)
    stop = StopRequest()
    try:
        if plan.namespace:
            enter_network(plan.namespace)
        rules = WorkerRules(idle_exit_s=0.0, beat_s=plan.beat_s, grace_s=plan.grace_s)
        with signals_to(stop, lambda text: None), _executor(plan) as executor:
            WorkerLoop(wait_for_database(plan.storage), executor, rules, stop, print).run()
    except BaseException:
        traceback.print_exc()
        os._exit(1)
    os._exit(130 if stop.level else 0)


def attend(plan: WorkerPlan, site: str) -> None:
    """Work on the study as ``gtf-tune study run`` does, notes and figures included: the body of a study process."""
    from gtf_tune.cli.study.run import open_for_work, work_on

    _prepare(plan, site)
    try:
        study = open_for_work(wait_for_database(plan.storage), NAME, None, False)
        work_on(study, _executor(plan), trial_parallel=1)
    except BaseException:
        traceback.print_exc()
        os._exit(1)
    os._exit(0)


def _prepare(plan: WorkerPlan, site: str) -> None:
    """Let this process find the counted pipeline, and leave what it is killed over in the test's own folder."""
    sys.path.insert(0, site)
    os.environ.update({counted.LOG_VARIABLE: str(plan.log), counted.PAUSE_VARIABLE: str(plan.pause_s)})
    os.environ[counted.CLOCK_VARIABLE] = str(clock_beside(plan.log))
    counted.follow_clock()
    tempfile.tempdir = str(plan.log.parent)
    # Its children would import pytest first: a third of what it takes to start one.
    main = sys.modules["__main__"]
    main.__spec__ = None
    vars(main).pop("__file__", None)


def clock_beside(log: Path) -> Path:
    """Return the file that says by how many seconds the clock of a study's workers is wrong."""
    return log.with_name("clock")


def enter_network(namespace: str) -> None:
    """Move this process to a network namespace, and to a host name of its own: it is then another machine."""
    libc = ctypes.CDLL(None, use_errno=True)
    with Path(f"/run/netns/{namespace}").open("rb") as network:
        if libc.setns(network.fileno(), _CLONE_NEWNET) or libc.unshare(_CLONE_NEWUTS):
            raise OSError(ctypes.get_errno(), "cannot enter the network namespace")
    socket.sethostname(namespace)


def _executor(plan: WorkerPlan) -> Executor:
    if not plan.jobs:
        return InlineExecutor()
    cache = plan.cache or plan.log.parent / "cache"
    return LocalExecutor(plan.jobs, StageCache(cache), scratch=cache / "scratch")


@dataclass
class Disturbed:
    """A study that is worked on by processes which this test kills."""

    storage: str
    room: Path
    folder: Path
    site: Path
    workers: list[BaseProcess] = field(default_factory=list)
    witnessed: list[tuple[int, set[str]]] = field(default_factory=list)

    @property
    def log(self) -> Path:
        return self.folder / "runs.log"

    def create(self, **sections: Any) -> None:
        """Create the study."""
        database = create_database(self.storage)
        create_study(database, checked_definition(definition(self.room, **sections), "test"), self.room)
        database.close()

    def start(self, body: Callable[[WorkerPlan, str], None] = work, **plan: Any) -> BaseProcess:
        """Start a worker process, or a study process by another ``body``, and return it."""
        process = CONTEXT.Process(target=body, args=(WorkerPlan(self.storage, self.log, **plan), str(self.site)))
        process.start()
        self.workers.append(process)
        return process

    def begun(self) -> list[str]:
        """Return the identities of all runs that have begun so far, in order."""
        return self.log.read_text().split() if self.log.exists() else []

    def kill(self, process: BaseProcess) -> None:
        """Kill a worker by SIGKILL, wait until all that it had started is gone, and note what is stored by now."""
        family: list[psutil.Process] = []
        with suppress(psutil.NoSuchProcess):
            family.append(psutil.Process(process.pid))
            family += family[0].children(recursive=True)
        process.kill()
        process.join(PATIENCE_S)
        wait_until(lambda: not any(is_running(one) for one in family))
        self.witness()

    def witness(self) -> None:
        """Note which runs are stored now: none of them may begin again."""
        database = open_database(self.storage)
        known = stored(database)  # first, since other workers may begin and store a run between the two
        self.witnessed.append((len(self.begun()), known))
        database.close()

    def finish(self, processes: list[BaseProcess] | None = None, **plan: Any) -> None:
        """Let one more worker, or those that are given, work to the end."""
        for process in processes or [self.start(**plan)]:
            process.join(_WORK_PATIENCE_S)
            assert process.exitcode == 0, f"a worker ended with {process.exitcode}"

    def check(self, undisturbed_digest: str, repeats: int = 0) -> None:
        """Check the digest, the budget, and that no run that was stored at some moment began again afterwards.

        ``repeats`` of them may: a worker that was frozen until another one had taken its trial begins what it still has
        in hand before it learns of that.
        """
        database = open_database(self.storage)
        study = studies.get(database, NAME)
        found = study_digest(database, NAME)
        counts = trials.counts(database, study.id)
        optuna_trials = _optuna_trials(database)
        database.close()
        assert study.state == "done"
        assert set(counts) <= {"complete", "pruned"}
        assert optuna_trials == sum(counts.values())
        assert found == undisturbed_digest
        begun = self.begun()
        again = {run for position, known in self.witnessed for run in known & set(begun[position:])}
        assert len(again) <= repeats, f"{len(again)} finished runs were executed again"


def _optuna_trials(database: Database) -> int:
    from gtf_tune.store.optuna.tables import optuna_storage

    storage = optuna_storage(database)
    return storage.get_n_trials(storage.get_study_id_from_name(NAME))


def stored(database: Database) -> set[str]:
    """Return the identities of all stored runs that trials may use: those that this machine spoiled are made again."""
    from sqlalchemy import select

    from gtf_tune.store.database import models
    from gtf_tune.store.database.session import columns_of, read_rows

    found = [runs.StoredRun(*row) for row in read_rows(database, select(*columns_of(models.Run, runs.StoredRun)))]
    usable = [run for run in found if run.diagnostics.get("failure") != "machine"]
    return {counted.identity(run.seed, run.noise_seed, run.options) for run in usable}


def is_running(process: psutil.Process) -> bool:
    """Return True if a process lives; one that ended but is not reaped yet does not."""
    with suppress(psutil.NoSuchProcess):
        return process.is_running() and process.status() != psutil.STATUS_ZOMBIE
    return False


def wait_until(condition: Callable[[], object], timeout_s: float = PATIENCE_S) -> None:
    """Return as soon as the condition holds."""
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline, "what the test waits for did not happen"
        time.sleep(0.01)


CONTEXT = get_context("forkserver")
CONTEXT.set_forkserver_preload(
    [
        "tests.faults.disturbance",
        "optuna",
        "gtf_tune.store.optuna.retrying_storage",
        "gtf_tune.report.dashboard.sync",
        "gtf_tune.report.build",
        "gtf_tune.study.tune.start",
    ]
)
