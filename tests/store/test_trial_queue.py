from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from sqlalchemy import text

from gtf_tune.store import trial_queue, trials
from gtf_tune.store.database import Database, open_database
from gtf_tune.store.studies import Study
from gtf_tune.store.trial_queue import TrialLease, TrialResult, Worker, this_worker

ELSEWHERE = Worker("there:1", "there", "another machine", 1, 1)
COMPLETE = TrialResult("complete", value=0.25, feasible=True, gtf_ate=0.25)


def claim(database: Database, study: Study, budget: int = 9, worker: Worker = ELSEWHERE) -> TrialLease:
    lease = trial_queue.lease_trial(database, study.id, budget, worker)
    assert lease is not None
    return lease


def silence(database: Database, lease: TrialLease, seconds: float) -> None:
    with database.engine.begin() as connection:
        values = {"seconds": seconds, "id": lease.trial_id}
        connection.execute(text("UPDATE gtf_trial SET heartbeat_at = heartbeat_at - :seconds WHERE id = :id"), values)


def finish_nominal(database: Database, study: Study) -> None:
    assert trial_queue.finish(database, claim(database, study), COMPLETE)


def test_trials_count_up_to_the_budget(database: Database, study: Study) -> None:
    finish_nominal(database, study)
    taken = [trial_queue.lease_trial(database, study.id, 3, ELSEWHERE) for _ in range(4)]
    assert [lease and lease.number for lease in taken] == [1, 2, None, None]


def test_no_trial_is_handed_out_while_the_nominal_trial_is_in_work(database: Database, study: Study) -> None:
    nominal = claim(database, study)
    early = trial_queue.lease_trial(database, study.id, 9, ELSEWHERE)
    trial_queue.finish(database, nominal, COMPLETE)

    assert early is None
    assert claim(database, study).number == 1


def test_eight_workers_never_overshoot_a_budget(storage: str, make_study: Callable[..., Study]) -> None:
    databases = [open_database(storage) for _ in range(8)]
    study = make_study(databases[0])
    finish_nominal(databases[0], study)

    def work(database: Database) -> list[int]:
        taken = []
        while (lease := trial_queue.lease_trial(database, study.id, 40, this_worker())) is not None:
            taken.append(lease.number)
        return taken

    with ThreadPoolExecutor(8) as pool:
        numbers = [one for taken in pool.map(work, databases) for one in taken]
    for database in databases:
        database.close()
    assert sorted(numbers) == list(range(1, 40))


def test_a_beating_trial_is_not_adopted(database: Database, study: Study) -> None:
    lease = claim(database, study)
    silence(database, lease, 100)
    assert trial_queue.renew(database, lease)
    assert trial_queue.adopt_stale(database, study.id, this_worker(), grace_s=60) is None


@pytest.mark.parametrize("seconds", [100, -100])
def test_a_silent_trial_is_adopted_with_its_optuna_trial(database: Database, study: Study, seconds: float) -> None:
    lease = claim(database, study)
    assert trial_queue.attach_optuna_trial(database, lease, 7, 3, {"a.b": 0.1})
    silence(database, lease, seconds)

    adopted = trial_queue.adopt_stale(database, study.id, this_worker(), grace_s=60)

    assert adopted is not None
    expected = TrialLease(lease.trial_id, study.id, 0, adopted.token, 2, 7, 3, {"a.b": 0.1})
    assert adopted == expected
    assert adopted.token != lease.token


def test_a_worker_that_lost_its_trial_changes_nothing(database: Database, study: Study) -> None:
    lost = claim(database, study)
    silence(database, lost, 100)
    kept = trial_queue.adopt_stale(database, study.id, this_worker(), grace_s=60)
    assert kept is not None

    assert not trial_queue.renew(database, lost)
    assert not trial_queue.is_held(database, lost)
    assert not trial_queue.attach_optuna_trial(database, lost, 1, 1, {})
    assert not trial_queue.release(database, lost)
    assert not trial_queue.finish(database, lost, replace(COMPLETE, value=9.0))
    assert trial_queue.finish(database, kept, COMPLETE)
    assert not trial_queue.finish(database, lost, replace(COMPLETE, value=9.0))
    assert trials.get(database, study.id, 0).value == 0.25


def test_only_one_of_many_adopts_a_trial(storage: str, make_study: Callable[..., Study]) -> None:
    databases = [open_database(storage) for _ in range(8)]
    study = make_study(databases[0])
    trial_queue.release(databases[0], claim(databases[0], study))

    with ThreadPoolExecutor(8) as pool:
        work = [pool.submit(trial_queue.adopt_stale, one, study.id, ELSEWHERE, 60) for one in databases]
        adopted = [one.result() for one in work]
    for database in databases:
        database.close()

    assert sum(lease is not None for lease in adopted) == 1


def test_a_released_trial_is_adopted_at_once(database: Database, study: Study) -> None:
    lease = claim(database, study)
    assert trial_queue.release(database, lease)
    adopted = trial_queue.adopt_stale(database, study.id, this_worker(), grace_s=1e9)
    assert adopted is not None
    assert adopted.number == lease.number


def test_a_trial_of_a_dead_process_of_this_machine_is_adopted_at_once(database: Database, study: Study) -> None:
    me = this_worker()
    claim(database, study, worker=replace(me, pid_started=me.pid_started - 1))
    assert trial_queue.adopt_stale(database, study.id, me, grace_s=1e9) is not None


def test_a_trial_of_a_live_process_of_this_machine_is_left_alone(database: Database, study: Study) -> None:
    claim(database, study, worker=this_worker())
    assert trial_queue.adopt_stale(database, study.id, this_worker(), grace_s=1e9) is None


def test_a_finished_trial_stays_finished(database: Database, study: Study) -> None:
    lease = claim(database, study)
    assert trial_queue.finish(database, lease, COMPLETE)
    assert trial_queue.finish(database, lease, COMPLETE), "the answer to the first commit may have been lost"
    assert not trial_queue.release(database, lease)
    assert trial_queue.adopt_stale(database, study.id, this_worker(), grace_s=0) is None


def test_workers_are_listed_with_their_trials_and_their_silence(database: Database, study: Study) -> None:
    finish_nominal(database, study)
    here = Worker("here:2", "here", "a machine", 2, 2)
    leases = [claim(database, study), claim(database, study, worker=here), claim(database, study)]
    silence(database, leases[0], 100)
    silence(database, leases[2], 30)

    found = trial_queue.active_workers(database, study.id)

    assert [(worker.name, worker.host, worker.numbers) for worker in found] == [
        ("here:2", "here", (2,)),
        ("there:1", "there", (1, 3)),
    ]
    assert found[0].silent_s < 10
    assert 30 <= found[1].silent_s < 40


def test_a_worker_that_gave_its_trial_back_is_not_listed(database: Database, study: Study) -> None:
    trial_queue.release(database, claim(database, study))

    assert trial_queue.active_workers(database, study.id) == []
