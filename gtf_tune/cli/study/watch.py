"""Follow a study that others work on."""

import time
from typing import TYPE_CHECKING, Annotated

import typer

from gtf_tune.cli.parameters import DEFAULT_STORAGE, Storage, StudyName, open_storage, storage_flag
from gtf_tune.cli.study.notes import suggest_outcome
from gtf_tune.cli.terminal.console import duration, say, write_line

if TYPE_CHECKING:
    from collections.abc import Sequence

    from gtf_tune.display import ScoreUnit
    from gtf_tune.store.trial_queue import ActiveWorker
    from gtf_tune.store.trials import Trial
    from gtf_tune.study.outcome.improvement import Improvement

_SILENT_S = 60.0
"""Seconds after which a worker that is not heard of is mentioned again; heartbeats come every 15 seconds."""

_IDLE_LOOKS = 2


def watch(
    name: StudyName,
    interval: Annotated[
        float, typer.Option("--interval", min=0.1, max=86_400, help="Seconds between two looks.")
    ] = 2.0,
    storage: Storage = DEFAULT_STORAGE,
) -> None:
    """Follow a study until it is done: a line for every trial that ends, and who works on it where.

    Example: gtf-tune study watch photos
    """
    from gtf_tune.display import definition_unit
    from gtf_tune.store import studies, trial_queue, trials
    from gtf_tune.store.studies import stored_definition
    from gtf_tune.study.outcome.improvement import read_improvements
    from gtf_tune.study.work.heartbeat import GRACE_S

    database = open_storage(storage)
    shown: set[int] = set()
    watched = _Workers(name, storage_flag(database))
    unit = definition_unit(stored_definition(studies.get(database, name)))
    while True:
        study = studies.get(database, name)
        known = trials.of_study(database, study.id)
        ended = [trial for trial in known if trial.state != "claimed" and trial.number not in shown]
        improvements = read_improvements(database, study.id, ended)
        for trial in ended:
            shown.add(trial.number)
            write_line(_line(trial, improvements.get(trial.number), unit))
        if study.state == "done":
            say(f"study '{name}' is done")
            suggest_outcome(database, name)
            return
        workers = trial_queue.active_workers(database, study.id)
        watched.look([worker for worker in workers if worker.silent_s <= GRACE_S], study.state)
        time.sleep(interval)


class _Workers:
    """What was last said of the workers of a study: a line is written when that changes."""

    def __init__(self, study: str, flag: str) -> None:
        self._study = study
        self._flag = flag
        self._said = ""
        self._idle_looks = 0

    def look(self, workers: "Sequence[ActiveWorker]", state: str) -> None:
        """Say who works, on which trials, and when each was last heard of, where that has changed."""
        # Between two trials a worker holds none for a moment.
        self._idle_looks = 0 if workers else self._idle_looks + 1
        if workers:
            self._say("; ".join(_worker_line(worker) for worker in workers), _summary(workers))
        elif self._idle_looks >= _IDLE_LOOKS:
            why = "nobody works on it" if state == "open" else f"it is {state}"
            line = f"study '{self._study}': {why}; go on with: gtf-tune study resume {self._study}{self._flag}"
            self._say(line, line)

    def _say(self, line: str, summary: str) -> None:
        if summary != self._said:
            self._said = summary
            say(line)


def _worker_line(worker: "ActiveWorker") -> str:
    trials = ", ".join(str(number) for number in worker.numbers)
    heard = f"last heard of {duration(max(worker.silent_s, 0.0))} ago"
    return f"{worker.name} on {worker.host}: trial{'s' if len(worker.numbers) > 1 else ''} {trials}, {heard}"


def _summary(workers: "Sequence[ActiveWorker]") -> str:
    """Return what a new line is written for: other workers, or one that has fallen silent or is back."""
    return "; ".join(f"{worker.name} {worker.silent_s > _SILENT_S}" for worker in workers)


def _line(trial: "Trial", improvement: "Improvement | None", unit: "ScoreUnit") -> str:
    name = "nominal" if trial.number == 0 else f"trial {trial.number}"
    if trial.value is None or not trial.feasible:
        return f"{name}: infeasible, {trial.message}"
    change = f", {improvement.text}" if improvement and improvement.is_known else ""
    early = ", stopped early" if trial.state == "pruned" else ""
    return f"{name}: {unit.told(trial.value)}{change}, {duration(trial.wall_s)} on {trial.host}{early}"
