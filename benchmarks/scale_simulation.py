"""Measure what a trial and a run cost the database, and say from that what very large studies would need.

    python -m benchmarks.scale_simulation [WORKERS ...]

starts a throw-away PostgreSQL, lets 1, 4, 16, 64 (or the given numbers of) workers tune the analytic pipeline, whose
runs take no time, counts statements, commits and bytes, measures how queries grow with the number of trials, feeds all
of it to a discrete-event model of many workers, and rewrites docs/scale.md. About five minutes on two cores.
"""

import heapq
import json
import os
import platform
import random
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from multiprocessing import get_context
from pathlib import Path

import psutil
from sqlalchemy import Engine, event, text

from benchmarks.scale_page import write_page
from gtf_tune.execution import InlineExecutor
from gtf_tune.store import studies, trial_queue, trials
from gtf_tune.store.database import Database, open_database
from gtf_tune.store.trial_queue import this_worker
from gtf_tune.study.create import checked_definition, create_study
from gtf_tune.study.open_study import open_study
from gtf_tune.study.work.server import WorkerLoop, WorkerRules
from tests.faults.servers import RestartableServer
from tests.study.conftest import write_sequence

TRIALS_PER_WORKER = 10
RUNS_PER_TRIAL = 8
FRAMES = 200
MANY_TRIALS = (1_000, 10_000)
RUN_SECONDS = (1.0, 10.0, 60.0)
FLEETS = (64, 250, 1_000, 4_000)
BEAT_S = 15.0
SERVER_CORES = 8
HORIZON_RUNS = 12
FILL = Path(__file__).with_name("scale_fill.sql")
CONTEXT = get_context("forkserver")
CONTEXT.set_forkserver_preload(["benchmarks.scale_simulation", "optuna", "gtf_tune.store.optuna.retrying_storage"])


@dataclass(frozen=True)
class TrialCost:
    """What one trial costs the database, its runs included."""

    statements: float
    statements_per_run: float
    commits: float
    sent_bytes: float
    stored_bytes: float
    stored_bytes_per_run: float
    worker_ms: float


@dataclass(frozen=True)
class Throughput:
    """What a number of workers reached on one server with runs that take no time."""

    workers: int
    trials_per_s: float
    commits_per_s: float
    server_ms_per_commit: float
    connections: int


@dataclass(frozen=True)
class QueryCost:
    """The time of the queries that grow with a study, and what a worker reads to begin, with its CPU time."""

    trials: int
    claim_ms: float
    adopt_ms: float
    untold_ms: float
    best_ms: float
    load_s: float
    load_megabytes: float


@dataclass(frozen=True)
class Forecast:
    """What the model says of a fleet: server load, lost time of workers, trials per hour."""

    workers: int
    run_s: float
    server_load: float
    waiting_share: float
    trials_per_hour: float


def main(fleets: list[int]) -> None:
    """Measure, model, and write the page."""
    server = RestartableServer.create()
    try:
        with tempfile.TemporaryDirectory() as folder:
            room = write_sequence(Path(folder) / "room", ground_truth=True, frames=FRAMES)
            cost = measure_trial(server, room)
            throughput = [measure_throughput(server, room, count) for count in fleets]
            queries = [measure_queries(server, room, count) for count in MANY_TRIALS]
    finally:
        server.remove()
    service_s = max(one.server_ms_per_commit for one in throughput) / 1000
    forecasts = [forecast(workers, run_s, cost.commits, service_s) for run_s in RUN_SECONDS for workers in FLEETS]
    figures = {
        "machine": f"{len(os.sched_getaffinity(0))} cores ({platform.machine()})",
        "runs_per_trial": RUNS_PER_TRIAL,
        "frames": FRAMES,
        "server_cores": SERVER_CORES,
        "cost": asdict(cost),
        "throughput": [asdict(one) for one in throughput],
        "queries": [asdict(query) for query in queries],
        "service_ms": 1000 * service_s,
        "forecasts": [asdict(one) for one in forecasts],
    }
    sys.stdout.write(json.dumps(figures, indent=2) + "\n")
    write_page(figures)


def create(storage: str, room: Path, count: int, name: str = "scale") -> None:
    """Create a study of so many random settings."""
    definition = {
        "name": name,
        "pipeline": {"name": "analytic"},
        "sequences": [{"name": "room", "path": str(room)}],
        "space": {"filter.max_error": {"low": 1e-3, "high": 0.1, "log": True}},
        "gtf": {"clean_runs": 2, "noisy_runs": RUNS_PER_TRIAL - 2, "noise_sigma": 5.0},
        "search": {"sampler": "random", "trials": count},
    }
    database = open_database(storage)
    create_study(database, checked_definition(definition, "benchmark"), room)
    database.close()


def serve(storage: str) -> None:
    """Work until nothing is left to do."""
    database = open_database(storage)
    WorkerLoop(database, InlineExecutor(), WorkerRules()).run()
    database.close()


@contextmanager
def counted_statements(counts: Counter[str]) -> Iterator[None]:
    """Count statements, by what they do, and the bytes of their text and values."""

    def count(_c: object, _u: object, statement: str, values: object, _x: object, _m: object) -> None:
        counts["statements"] += 1
        counts["bytes"] += len(statement) + len(str(values))
        counts["runs"] += statement.startswith("INSERT INTO gtf_run ")
        counts["about runs"] += "gtf_run" in statement and "gtf_trial" not in statement

    event.listen(Engine, "before_cursor_execute", count)
    try:
        yield
    finally:
        event.remove(Engine, "before_cursor_execute", count)


def measure_trial(server: RestartableServer, room: Path) -> TrialCost:
    """Measure the trials of one worker in this process."""
    storage = server.new_storage()
    create(storage, room, TRIALS_PER_WORKER)
    database = open_database(storage)
    before, commits = stored_bytes(database), committed(database)
    counts: Counter[str] = Counter()
    began = time.perf_counter()
    with counted_statements(counts):
        serve(storage)
    took = time.perf_counter() - began
    in_runs = table_bytes(database, "gtf_run", "gtf_run_output")
    cost = TrialCost(
        statements=counts["statements"] / TRIALS_PER_WORKER,
        statements_per_run=counts["about runs"] / max(counts["runs"], 1),
        commits=(committed(database) - commits) / TRIALS_PER_WORKER,
        sent_bytes=counts["bytes"] / TRIALS_PER_WORKER,
        stored_bytes=(stored_bytes(database) - before) / TRIALS_PER_WORKER,
        stored_bytes_per_run=in_runs / max(counts["runs"], 1),
        worker_ms=1000 * took / TRIALS_PER_WORKER,
    )
    database.close()
    return cost


def measure_throughput(server: RestartableServer, room: Path, workers: int) -> Throughput:
    """Measure how many trials so many workers make at once when runs take no time."""
    storage = server.new_storage()
    total = max(4 * workers, 2 * TRIALS_PER_WORKER)
    create(storage, room, total)
    database = open_database(storage)
    processes = [CONTEXT.Process(target=serve, args=(storage,)) for _ in range(workers)]
    for process in processes:
        process.start()
    wait_for_trials(database, workers)
    began, first, commits = time.perf_counter(), finished(database), committed(database)
    cpu = server_cpu_s(database)
    wait_for_trials(database, total - workers)
    took, made, cpu_after = time.perf_counter() - began, committed(database) - commits, server_cpu_s(database)
    spent_s = sum(cpu_after[pid] - cpu[pid] for pid in cpu if pid in cpu_after)
    found = Throughput(
        workers=workers,
        trials_per_s=(finished(database) - first) / took,
        commits_per_s=made / took,
        server_ms_per_commit=1000 * spent_s / made,
        connections=len(cpu_after),
    )
    for process in processes:
        process.join()
    database.close()
    return found


def measure_queries(server: RestartableServer, room: Path, count: int) -> QueryCost:
    """Measure the queries of a worker in a study of so many finished trials."""
    storage = server.new_storage()
    create(storage, room, 2 * count)
    database = open_database(storage)
    study = studies.get(database, "scale")
    fill(database, study, count)
    began = time.process_time()
    size = load_all(database)
    load_s = time.process_time() - began
    worker = this_worker()
    cost = QueryCost(
        trials=count,
        claim_ms=fastest_ms(lambda: trial_queue.lease_trial(database, study.id, 2 * count, worker)),
        adopt_ms=fastest_ms(lambda: trial_queue.adopt_stale(database, study.id, worker, 120.0)),
        untold_ms=fastest_ms(lambda: trials.untold(database, study.id)),
        best_ms=fastest_ms(lambda: trials.best(database, study.id, before=count)),
        load_s=load_s,
        load_megabytes=size / 1e6,
    )
    database.close()
    return cost


def fill(database: Database, study: studies.Study, count: int) -> None:
    """Insert finished trials, ours and Optuna's, as a long search leaves them."""
    numbers = {"optuna": study.optuna_study_id, "ours": study.id, "last": count - 1}
    with database.engine.begin() as connection:
        for statement in FILL.read_text(encoding="utf-8").split(";"):
            connection.exec_driver_sql(statement % numbers)
    with database.engine.execution_options(isolation_level="AUTOCOMMIT").connect() as connection:
        connection.execute(text("ANALYZE"))


def load_all(database: Database) -> int:
    """Read what every worker reads once when it opens a study, and return its size in bytes."""
    study = open_study(database, "scale").optuna_study
    return sum(len(repr(get_trial)) for get_trial in study.get_trials(deepcopy=False))


def forecast(workers: int, run_s: float, commits_per_trial: float, service_s: float) -> Forecast:
    """Follow a fleet through some runs of each worker, event by event.

    Each worker alternates between a run of ``run_s`` (give or take a quarter) and its share of the trial's commits; a
    beat every 15 s is one more. The server works on ``SERVER_CORES`` commits at a time, first come, first served.
    """
    chance = random.Random(0)
    commits_per_run = max(1, round(commits_per_trial / RUNS_PER_TRIAL + run_s / BEAT_S))
    horizon = HORIZON_RUNS * run_s
    free = [0.0] * SERVER_CORES
    # One event is a worker that asks for a commit, with the number of those that its run still needs.
    events = [(chance.uniform(0, run_s), worker, commits_per_run) for worker in range(workers)]
    heapq.heapify(events)
    served = waited = 0.0
    runs = 0
    while events[0][0] < horizon:
        now, worker, left = heapq.heappop(events)
        start = max(now, heapq.heappop(free))
        heapq.heappush(free, start + service_s)
        waited += start - now
        served += service_s
        runs += left == 1
        pause_s = run_s * chance.uniform(0.75, 1.25) if left == 1 else 0.0
        heapq.heappush(events, (start + service_s + pause_s, worker, left - 1 or commits_per_run))
    return Forecast(
        workers=workers,
        run_s=run_s,
        server_load=min(1.0, served / (horizon * SERVER_CORES)),
        waiting_share=min(1.0, waited / (horizon * workers)),
        trials_per_hour=runs / RUNS_PER_TRIAL * 3600 / horizon,
    )


def server_cpu_s(database: Database) -> dict[int, float]:
    """Return the CPU seconds of each server process that serves a database of this machine."""
    query = "SELECT pid FROM pg_stat_activity WHERE datname = current_database() AND pid <> pg_backend_pid()"
    with database.engine.connect() as connection:
        pids = [row[0] for row in connection.execute(text(query))]
    found = {}
    for pid in pids:
        with suppress(psutil.NoSuchProcess):
            times = psutil.Process(pid).cpu_times()
            found[pid] = times.user + times.system
    return found


def wait_for_trials(database: Database, count: int) -> None:
    while finished(database) < count:
        time.sleep(0.05)


def finished(database: Database) -> int:
    return count_of(database, "SELECT count(*) FROM gtf_trial WHERE state <> 'claimed'")


def committed(database: Database) -> int:
    return count_of(
        database, "SELECT pg_stat_get_db_xact_commit(oid) FROM pg_database WHERE datname = current_database()"
    )


def stored_bytes(database: Database) -> int:
    return count_of(database, "SELECT pg_database_size(current_database())")


def table_bytes(database: Database, *tables: str) -> int:
    return sum(count_of(database, f"SELECT pg_total_relation_size('{table}')") for table in tables)


def count_of(database: Database, query: str) -> int:
    with database.engine.connect() as connection:
        return int(connection.scalar(text(query)) or 0)


def fastest_ms(work: Callable[[], object], times: int = 15) -> float:
    """Return the shortest of some times: the machine may have other work, which only ever adds."""
    found = []
    for _ in range(times):
        began = time.perf_counter()
        work()
        found.append(time.perf_counter() - began)
    return 1000 * min(found)


if __name__ == "__main__":
    main([int(argument) for argument in sys.argv[1:]] or [1, 4, 16, 64])
