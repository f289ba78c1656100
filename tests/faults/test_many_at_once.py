"""Many processes at one study: creation, a single SQLite file, and the exact budget."""

from collections.abc import Callable
from multiprocessing.queues import SimpleQueue
from pathlib import Path
from typing import Any

import pytest

from gtf_tune.errors import GtfTuneError
from gtf_tune.store.database import create_database
from gtf_tune.study.create import checked_definition, create_study
from tests.faults.conftest import Disturb
from tests.faults.disturbance import CONTEXT, PATIENCE_S, definition

WORKERS = 8


def try_to_create(storage: str, site: str, room: str, answers: "SimpleQueue[str]") -> None:
    """Create the study and say how that went."""
    import sys

    sys.path.insert(0, site)
    try:
        create_study(create_database(storage), checked_definition(definition(Path(room)), "test"), Path(room))
        answers.put("created")
    except GtfTuneError as error:
        answers.put(str(error))


@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
def test_of_many_that_create_a_study_at_once_one_succeeds_and_the_others_are_told(
    backend: str, make_storage: Callable[..., str], site: Path, shared_room: Path
) -> None:
    storage = make_storage(backend, False)
    answers: SimpleQueue[str] = CONTEXT.SimpleQueue()
    processes: list[Any] = [
        CONTEXT.Process(target=try_to_create, args=(storage, str(site), str(shared_room), answers)) for _ in range(3)
    ]
    for process in processes:
        process.start()
    said = [answers.get() for _ in processes]
    for process in processes:
        process.join(PATIENCE_S)

    assert said.count("created") == 1
    assert all("exists already" in one for one in said if one != "created"), said


@pytest.mark.parametrize("backend", ["sqlite", "postgresql"])
def test_eight_processes_keep_the_budget_and_never_see_a_locked_database(
    backend: str, disturb: Disturb, make_storage: Callable[..., str], undisturbed: Callable[..., str]
) -> None:
    study = disturb(make_storage(backend, True))
    study.create(search={"trials": 12})

    study.finish([study.start(pause_s=0.0) for _ in range(WORKERS)])

    study.check(undisturbed(search={"trials": 12}))
    assert len(study.begun()) == len(set(study.begun())) == 12 * 4
