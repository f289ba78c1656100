"""Write docs/scale.md from measured figures; no number in it is typed by hand."""
# ruff: noqa: E501 (a row of a Markdown table is one line)

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

PAGE = Path(__file__).parents[1] / "docs" / "scale.md"
_HOUR_S = 3600
_TERABYTE = 1e12
_LARGE_TRIALS = 100_000
_LARGE_RUNS = 10_000_000
_LARGE_FLEET = 1_000
_BEATS_PER_S = 1 / 15


def write_page(figures: Mapping[str, Any], path: Path = PAGE) -> None:
    """Write the page."""
    path.write_text("\n\n".join([_measured(figures), _growing(figures), _modelled(figures), _large(figures)]) + "\n")


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table, numbers to the right."""
    lines = [header, ["---", *["---:"] * (len(header) - 1)], *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def _measured(figures: Mapping[str, Any]) -> str:
    cost = figures["cost"]
    rows = [
        ["statements sent", f"{cost['statements']:.0f}", f"{cost['statements_per_run']:.1f}"],
        ["commits", f"{cost['commits']:.0f}", "1"],
        ["kB sent (text and values of statements)", f"{cost['sent_bytes'] / 1e3:.0f}", ""],
        [
            "kB stored, indexes included",
            f"{cost['stored_bytes'] / 1e3:.0f}",
            f"{cost['stored_bytes_per_run'] / 1e3:.1f}",
        ],
        ["ms of a worker, pipeline included", f"{cost['worker_ms']:.0f}", ""],
    ]
    fleets = [
        [
            str(figure["workers"]),
            f"{figure['trials_per_s']:.1f}",
            f"{figure['commits_per_s']:.0f}",
            f"{figure['server_ms_per_commit']:.2f}",
            f"{figure['connections'] / figure['workers']:.1f}",
        ]
        for figure in figures["throughput"]
    ]
    return f"""# Scale

What a study costs its database, measured; and what very large ones would need, modelled. Made by
`python -m benchmarks.scale_simulation`, with the analytic pipeline (its runs take no time, so that only gtf-tune, Optuna
and PostgreSQL are measured), on {figures["machine"]} shared with the server and the workers. Times also contain
what else the machine did meanwhile; statements, commits and bytes do not depend on it.

## What a trial costs

A trial of {figures["runs_per_trial"]} runs on {figures["frames"]} frames, random settings, one worker:

{table(["", "a trial", "of it, a run"], rows)}

A worker has one heartbeat of one statement every 15 s for each trial in work. It holds one connection, two while it
works on a trial.

Several workers at once, with runs that take no time (real ones take seconds to minutes), all on the same cores as the server:

{table(["workers", "trials per s", "commits per s", "server's CPU, ms a commit", "connections per worker"], fleets)}"""


def _growing(figures: Mapping[str, Any]) -> str:
    names = ("claim_ms", "adopt_ms", "untold_ms", "best_ms")
    rows = [
        [
            f"{figure['trials']:,}",
            *(f"{figure[name]:.1f}" for name in names),
            f"{figure['load_s']:.1f}",
            f"{figure['load_megabytes']:.0f}",
        ]
        for figure in figures["queries"]
    ]
    header = ["finished trials", "claim, ms", "look for dead, ms", "look for untold, ms", "read best, ms"]
    return f"""## What grows with a study

Each of these is asked once a trial; the last two columns are what a worker reads when it opens the study, because Optuna's
samplers keep all trials in memory:

{table([*header, "open, s of CPU", "open, MB of text"], rows)}"""


def _modelled(figures: Mapping[str, Any]) -> str:
    rows = [
        [
            f"{figure['workers']:,}",
            f"{figure['run_s']:g}",
            f"{figure['server_load']:.0%}",
            f"{figure['waiting_share']:.1%}",
            f"{figure['trials_per_hour']:,.0f}",
        ]
        for figure in figures["forecasts"]
    ]
    return f"""## Many workers

A discrete-event model: workers alternate between a run (of the given length, give or take a quarter) and their commits;
a server with {figures["server_cores"]} cores takes {figures["service_ms"]:.2f} ms of a core for each, the largest of the measurements above.

{table(["workers", "run, s", "server busy", "workers' time lost", "trials per hour"], rows)}"""


def _large(figures: Mapping[str, Any]) -> str:
    cost = figures["cost"]
    largest = {name: _extrapolated(figures["queries"], name) for name in figures["queries"][-1]}
    stored_tb = _LARGE_RUNS * cost["stored_bytes_per_run"] / _TERABYTE
    loads_gb = _LARGE_FLEET * largest["load_megabytes"] / 1e3
    connections = 2 * _LARGE_FLEET
    beats = _LARGE_FLEET * _BEATS_PER_S
    per_trial_ms = sum(largest[name] for name in ("claim_ms", "adopt_ms", "untold_ms", "best_ms"))
    hours = _LARGE_TRIALS * per_trial_ms / 1e3 / figures["server_cores"] / _HOUR_S
    reading = f"{largest['load_megabytes']:.0f} MB and {largest['load_s']:.0f} s of CPU each, {loads_gb:.0f} GB in all"
    return f"""## A thousand workers, a hundred thousand trials, ten million runs

| in order of breaking | figure | what takes over |
|---|---|---|
| connections: {_LARGE_FLEET:,} workers | {connections:,}; PostgreSQL allows 100 unless told otherwise | PgBouncer in transaction mode (1.21 or newer, since the driver prepares statements), or fewer workers with more `--jobs`, or `--executor dask://`: its workers need no connection |
| every worker reads all trials once | {reading}, at {_LARGE_TRIALS:,} trials | long-lived workers (`gtf-tune worker` opens a study once); few drivers with Dask behind them; several studies |
| queries that grow with the study | {per_trial_ms:.0f} ms a trial at {_LARGE_TRIALS:,} trials, {hours:.1f} h of a {figures["server_cores"]}-core server for {_LARGE_TRIALS:,} | several studies: runs are shared between them by key, so splitting costs nothing |
| adaptive samplers | refine, TPE and GP look at all trials before each one, in the worker | `random` or `qmc`, whose trials follow from their number alone; several studies |
| stored trajectories: {_LARGE_RUNS:,} runs of {figures["frames"]} frames | {stored_tb:.2f} TB, linear in frames and runs | a larger disk first (rows are only appended); then object storage for the trajectories, which are one table (`gtf_run_output`) that no listing reads |
| heartbeats | {beats:.0f} statements per second | nothing needed |

Figures at {_LARGE_TRIALS:,} trials continue the straight line through those that were measured. PgBouncer was not tried here.

Nothing here waits on a lock that all workers share but the claim of a trial, which takes a row lock of the study for the
time of two statements."""


def _extrapolated(queries: Sequence[Mapping[str, float]], name: str) -> float:
    first, last = queries[0], queries[-1]
    slope = max(0.0, (last[name] - first[name]) / (last["trials"] - first["trials"]))
    return last[name] + slope * (_LARGE_TRIALS - last["trials"])
