"""Fill a database with a study that never ran: two options, ground truth, infeasible, pruned and failed trials.

Trajectories come from the analytic pipeline, scores from `gtf_score`, everything else is written through the store as
the study loop would.
"""

import math
import shutil
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import pytest
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution
from optuna.trial import TrialState, create_trial

from gtf_tune.definition import definition_from_dict, dump_definition
from gtf_tune.errors import RunError
from gtf_tune.gtf import GtfScore, GtfSettings, gtf_score
from gtf_tune.metrics import ate
from gtf_tune.pipelines.analytic import create, expected_error, ground_truth, imaginary_sequence
from gtf_tune.pipelines.base import PipelineJob
from gtf_tune.pipelines.run import RunOutcome, RunRequest
from gtf_tune.report.study_data import StudyData, read_study
from gtf_tune.store import confirmations, ground_truth_errors, runs, studies, trial_queue
from gtf_tune.store.database import Database, create_database, open_database
from gtf_tune.store.ground_truth_errors import Validation
from gtf_tune.store.optuna.tables import optuna_storage
from gtf_tune.store.runs import TrialRun
from gtf_tune.store.studies import NewStudy, Study, StudySequence
from gtf_tune.store.trial_queue import TrialLease, TrialResult, this_worker
from gtf_tune.study.outcome.verdict import ADOPT
from gtf_tune.trajectory import Trajectory
from gtf_tune.trajectory.alignment import MIN_MATCHED
from tests.store.conftest import (  # noqa: F401 (fixtures)
    make_storage,
    postgresql_server,
    postgresql_template,
)

FRAMES = 24
CLEAN, NOISY = 2, 4
MAX_ERROR, KERNEL = "filter.max_error", "robust.kernel"
NOMINAL = {MAX_ERROR: 0.01, KERNEL: "huber"}
OPTIONS = [
    NOMINAL,
    {MAX_ERROR: 0.05, KERNEL: "huber"},
    {MAX_ERROR: 0.004, KERNEL: "huber"},
    {MAX_ERROR: 0.002, KERNEL: "cauchy"},
    {MAX_ERROR: 0.0008, KERNEL: "cauchy"},
    {MAX_ERROR: 0.02, KERNEL: "trivial"},
    {MAX_ERROR: 0.00001, KERNEL: "huber"},
    {MAX_ERROR: 0.0015, KERNEL: "huber"},
    {MAX_ERROR: 0.003, KERNEL: "cauchy"},
    {MAX_ERROR: 0.1, KERNEL: "trivial"},
]
INFEASIBLE, PRUNED, FAILED = 6, 5, 9
BEST = 3
REASON = "the pipeline crashed its process (SIGABRT)"
LOG = (
    "".join(f"I1123 mapping step {step}\n" for step in range(40))
    + "F1123 Check failed: x < 3 <script>alert(1)</script>\n"
)
BEGIN = 1.7e9


@pytest.fixture(scope="session")
def storage_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a SQLite file with the studies ``synthetic``, ``two`` (sequences), ``single`` (option) and ``empty``."""
    path = tmp_path_factory.mktemp("storage") / "studies.db"
    database = create_database(str(path))
    write_study(database)
    write_study(database, Scene(name="two", sequences=("walk", "room"), options=OPTIONS[:6], with_faults=False))
    single = [{MAX_ERROR: value} for value in (0.01, 0.0005, 0.002, 0.05)]
    write_study(database, Scene(name="single", options=single, with_truth=False, with_faults=False))
    write_study(database, Scene(name="empty", options=[], with_truth=False))
    database.close()
    return path


@pytest.fixture(scope="session")
def database(storage_file: Path) -> Iterator[Database]:
    """Yield the storage of `storage_file`; tests only read it."""
    opened = open_database(str(storage_file))
    yield opened
    opened.close()


@pytest.fixture
def own_database(storage_file: Path, tmp_path: Path) -> Iterator[Database]:
    """Yield a copy of the storage of `storage_file` that a test may change."""
    path = tmp_path / "own.db"
    shutil.copy(storage_file, path)
    opened = open_database(str(path))
    yield opened
    opened.close()


@pytest.fixture(scope="session")
def data(database: Database) -> StudyData:
    """Return the study ``synthetic``."""
    return read_study(database, "synthetic")


@pytest.fixture
def confirm_study() -> Callable[[Database, str], None]:
    """Return a function that adds a confirmation of the best trial of ``synthetic`` with a verdict."""
    return lambda database, verdict: confirm(database, studies.get(database, "synthetic"), verdict)


@dataclass(frozen=True)
class Scene:
    """Say what kind of study to write."""

    name: str = "synthetic"
    sequences: tuple[str, ...] = ("walk",)
    options: Sequence[Mapping[str, Any]] = field(default_factory=lambda: OPTIONS)
    with_truth: bool = True
    with_faults: bool = True

    @property
    def space(self) -> dict[str, Any]:
        space: dict[str, Any] = {MAX_ERROR: {"low": 1e-5, "high": 0.1, "log": True}}
        kernels = {KERNEL: {"values": ["trivial", "huber", "cauchy"]}}
        return {**space, **kernels} if any(KERNEL in options for options in self.options) else space


def write_study(database: Database, scene: Scene = Scene()) -> Study:
    """Write a study and return it."""
    definition = definition_from_dict(
        {
            "name": scene.name,
            "pipeline": {"name": "analytic"},
            "sequences": [{"name": name, "path": f"data/{name}"} for name in scene.sequences],
            "space": scene.space,
            "gtf": {"clean_runs": CLEAN, "noisy_runs": NOISY},
            "search": {"trials": max(len(scene.options), 1)},
        }
    )
    optuna_study = optuna.create_study(study_name=scene.name, storage=optuna_storage(database), direction="minimize")
    resolved = {"noise_sigma": dict.fromkeys(scene.sequences, 5.0), "versions": {"gtf_tune": "0.1.0", "analytic": "1"}}
    rows = tuple(
        StudySequence(name, f"data/{name}", "tum", name[0] * 64, FRAMES, 64, 48, "unknown", scene.with_truth)
        for name in scene.sequences
    )
    study = studies.add(
        database, NewStudy(scene.name, optuna_study._study_id, dump_definition(definition), resolved, "/data", rows)
    )
    writer = _Writer(database, study, optuna_study, scene)
    for _ in scene.options:
        writer.write_trial()
    return study


def confirm(database: Database, study: Study, verdict: str, number: int = BEST) -> None:
    """Add a confirmation with one candidate."""
    found = {"improvement": 0.31, "low": 0.22, "high": 0.39, "p_value": 0.002, "instances": 12}
    reasons = [] if verdict == ADOPT else ["not significantly better than nominal"]
    candidate = {"ordinal": number, "options": dict(OPTIONS[number]), "value": 6e-4, **found, "reasons": reasons}
    candidate |= {"adjusted_p_value": 0.004, "verdict": verdict, "by_sequence": {"walk": found}}
    result = {"candidates": [candidate], "verdict": verdict, "adopted": number if verdict == ADOPT else None}
    keys = [one.run.key for one in runs.of_study(database, study.id)][:3]
    confirmations.add(database, study.id, {"run_keys": keys}, result, verdict)


@dataclass
class _Writer:
    database: Database
    study: Study
    optuna_study: optuna.Study
    scene: Scene
    nominal: dict[str, float] = field(default_factory=dict)

    def write_trial(self) -> None:
        lease = trial_queue.lease_trial(self.database, self.study.id, len(self.scene.options), this_worker())
        assert lease is not None
        options = dict(self.scene.options[lease.number])
        state = self._state(lease.number)
        uses = self._uses(lease, options, state)
        runs.link(self.database, lease.trial_id, [use for _, use, _ in uses])
        result = self._result(lease, uses, state)
        self._tell_optuna(lease, options, result)
        trial_queue.finish(self.database, lease, result)
        if self.scene.with_truth:
            self._validate(lease, uses)

    def _state(self, number: int) -> str:
        faults = {INFEASIBLE: "infeasible", PRUNED: "pruned", FAILED: "failed"} if self.scene.with_faults else {}
        return faults.get(number, "complete")

    def _uses(
        self, lease: TrialLease, options: Mapping[str, Any], state: str
    ) -> list[tuple[str, TrialRun, Trajectory]]:
        uses = []
        for name in self.scene.sequences:
            for kind, count in (("clean", CLEAN), ("noisy", NOISY)):
                for index in range(count):
                    request = _request(name, options, kind, index)
                    number = lease.number * (CLEAN + NOISY) + index + (CLEAN if kind == "noisy" else 0)
                    outcome = _outcome(request, number, fails=state == "infeasible" and kind == "noisy" and index > 1)
                    stored = runs.save(self.database, request, outcome)
                    uses.append(
                        (
                            name,
                            TrialRun(lease.number, name, stored, lease.number == 2 and kind == "clean"),
                            outcome.trajectory,
                        )
                    )
        return uses

    def _result(self, lease: TrialLease, uses: list[tuple[str, TrialRun, Trajectory]], state: str) -> TrialResult:
        if state == "failed":
            return TrialResult("failed", message="the database went away", wall_s=1.0)
        scores = {name: _score(uses, name) for name in self.scene.sequences}
        if lease.number == 0:
            self.nominal = {name: score.value for name, score in scores.items()}
        feasible = state != "infeasible"
        several = len(scores) > 1
        value = float(np.exp(np.mean([math.log(score.value / self.nominal[name]) for name, score in scores.items()])))
        only = next(iter(scores.values()))
        value = value if several else only.value
        detail = {name: _detail(score, feasible) for name, score in scores.items()}
        return TrialResult(
            state="pruned" if state == "pruned" else "complete",
            value=value if feasible else 1.5,
            feasible=feasible,
            gtf_ate=value if feasible else None,
            standard_error=None if several else only.standard_error,
            ci_low=None if several else only.confidence_interval[0],
            ci_high=None if several else only.confidence_interval[1],
            coverage=1.0 if feasible else 0.0,
            collapsed_rate=float(only.collapsed.mean()),
            clean_runs=CLEAN,
            noisy_runs=NOISY,
            wall_s=12.5,
            message={"complete": "", "pruned": "stopped early: worse than trial 3"}.get(state, REASON),
            detail={"sequences": detail, "instances": only.instance_values.tolist() if feasible else []},
        )

    def _tell_optuna(self, lease: TrialLease, options: Mapping[str, Any], result: TrialResult) -> None:
        distributions: dict[str, BaseDistribution] = {MAX_ERROR: FloatDistribution(1e-5, 0.1, log=True)}
        if KERNEL in options:
            distributions[KERNEL] = CategoricalDistribution(("trivial", "huber", "cauchy"))
        states = {"complete": TrialState.COMPLETE, "pruned": TrialState.PRUNED, "failed": TrialState.FAIL}
        steps = {step: value for step, value in enumerate(result.detail.get("instances", []))}
        attributes = {"gtf_ate": result.gtf_ate, "coverage": result.coverage} if result.feasible else {}
        trial = create_trial(
            state=states[result.state],
            value=result.value if result.state == "complete" else None,
            params=dict(options),
            distributions=distributions,
            intermediate_values=steps,
            user_attrs=attributes,
        )
        storage = self.optuna_study._storage
        trial_id = storage.create_new_trial(self.optuna_study._study_id, template_trial=trial)
        number = storage.get_trial(trial_id).number
        trial_queue.attach_optuna_trial(self.database, lease, trial_id, number, options)

    def _validate(self, lease: TrialLease, uses: list[tuple[str, TrialRun, Trajectory]]) -> None:
        found = []
        for name in self.scene.sequences:
            clean = [run for of, use, run in uses if of == name and use.run.kind == "clean" and len(run) >= MIN_MATCHED]
            errors = [ate(ground_truth(range(FRAMES)), run) for run in clean]
            found.append(Validation(name, float(np.mean(errors)) if errors else None))
        ground_truth_errors.save(self.database, lease.trial_id, found)


def _request(sequence: str, options: Mapping[str, Any], kind: str, index: int) -> RunRequest:
    noisy = kind == "noisy"
    imaginary = imaginary_sequence(FRAMES)
    seed = 100 * sum(sequence.encode()) + index
    pipeline = create({"collapse_rate": 0.0})
    return RunRequest(
        pipeline, options, imaginary, kind, index, 5.0 if noisy else 0.0, seed + 7 if noisy else 0, seed + 50 * noisy
    )


def _outcome(request: RunRequest, number: int, *, fails: bool) -> RunOutcome:
    common: dict[str, Any] = {
        "wall_s": 2.0,
        "host": "node-a" if number % 3 else "node-b",
        "versions": {"analytic": "1"},
    }
    common |= {"started_at": BEGIN + 1.1 * number, "peak_memory_bytes": 300 * 2**20}
    job = PipelineJob(request.images, request.options, request.seed, 1, Path(), None)  # type: ignore[arg-type]
    try:
        trajectory = Trajectory.empty() if fails else request.pipeline.run(job).trajectory
    except RunError:
        trajectory = Trajectory.empty()
    if not len(trajectory):
        return RunOutcome("failed", Trajectory.empty(), error=REASON, log=LOG, **common)
    stages = {"features_s": 0.6, "features_cached": number % 2 == 0, "mapping_s": 1.2}
    reprojection = {"mean_reprojection_error_px": 0.5 + 40 * expected_error(request.options)}
    return RunOutcome("ok", trajectory, diagnostics={**stages, **reprojection}, **common)


def _score(uses: list[tuple[str, TrialRun, Trajectory]], sequence: str) -> GtfScore:
    mine = [(use, trajectory) for name, use, trajectory in uses if name == sequence]
    clean, noisy = ([one for use, one in mine if use.run.kind == kind] for kind in ("clean", "noisy"))
    return gtf_score(clean, noisy, GtfSettings(), FRAMES)


def _detail(score: GtfScore, feasible: bool) -> dict[str, Any]:
    matrix = [[value if math.isfinite(value) else None for value in row] for row in score.matrix.tolist()]
    return {
        "value": score.value if feasible else None,
        "standard_error": score.standard_error,
        "ci": list(score.confidence_interval),
        "matrix": matrix,
        "pair_errors": {f"{i},{j}": reason for (i, j), reason in score.pair_errors.items()},
        "coverage": float(min([*score.coverage_clean, *score.coverage_noisy])),
        "coverage_clean": score.coverage_clean.tolist(),
        "coverage_noisy": score.coverage_noisy.tolist(),
        "coverage_nominal": float(score.coverage_clean.min()),
        "collapsed": score.collapsed.tolist(),
        "extent": score.extent,
        "message": "" if feasible else REASON,
    }
