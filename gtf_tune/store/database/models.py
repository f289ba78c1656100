"""Lay out the tables of gtf-tune; they share a database with Optuna's and all start with ``gtf_``.

Times are seconds since 1970 UTC. Ground truth lives in `Validation` and nowhere else. What a run printed and the poses
that it found live in `RunOutput`, so that no listing reads them.
"""

from typing import Any, ClassVar

from sqlalchemy import BigInteger, ForeignKey, Index, LargeBinary, MetaData, String, UniqueConstraint
from sqlalchemy.orm import DeclarativeBase, Mapped, mapped_column

from gtf_tune.store.database.columns import Json, Real, Seed, Words

TABLE_PREFIX = "gtf_"

_CONSTRAINT_NAMES = {
    "ix": "ix_%(table_name)s_%(column_0_N_name)s",
    "uq": "uq_%(table_name)s_%(column_0_N_name)s",
    "fk": "fk_%(table_name)s_%(column_0_name)s",
    "pk": "pk_%(table_name)s",
}


class Base(DeclarativeBase):
    """Collect the tables, and say how Python's types are stored."""

    metadata = MetaData(naming_convention=_CONSTRAINT_NAMES)
    type_annotation_map: ClassVar[dict[Any, Any]] = {str: Words, float: Real, dict[str, Any]: Json}


def _owned_by(target: str) -> Any:
    """Make a foreign key whose row goes with the row that it points to."""
    return ForeignKey(target, ondelete="CASCADE")


class Study(Base):
    """A study: its definition as written, and what it was resolved to when it was created."""

    __tablename__ = "gtf_study"

    id: Mapped[int] = mapped_column(primary_key=True)
    name: Mapped[str] = mapped_column(unique=True)
    optuna_study_id: Mapped[int]
    state: Mapped[str]
    created_at: Mapped[float]
    definition: Mapped[str]
    resolved: Mapped[dict[str, Any]]
    root: Mapped[str]


class Sequence(Base):
    """One sequence of a study, as it looked when the study was created."""

    __tablename__ = "gtf_sequence"
    __table_args__ = (UniqueConstraint("study_id", "name"),)

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(_owned_by("gtf_study.id"))
    name: Mapped[str]
    path: Mapped[str]
    layout: Mapped[str]
    fingerprint: Mapped[str] = mapped_column(String(64))
    num_frames: Mapped[int]
    width: Mapped[int]
    height: Mapped[int]
    camera: Mapped[str]
    has_ground_truth: Mapped[bool]
    info: Mapped[dict[str, Any]]


class Trial(Base):
    """One trial of a study's budget and, once it has ended, its score.

    ``number`` (column ``ordinal``) counts the trials of the study from 0. ``lease`` (column ``claim``) is the token of
    the worker that works on the trial, NULL after a release. From ``machine``, ``pid`` and ``pid_started`` another
    process on the same machine knows whether that worker is alive.
    """

    __tablename__ = "gtf_trial"
    __table_args__ = (UniqueConstraint("study_id", "ordinal"), Index(None, "study_id", "state"))

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(_owned_by("gtf_study.id"))
    number: Mapped[int] = mapped_column("ordinal")
    optuna_trial_id: Mapped[int | None]
    optuna_number: Mapped[int | None]
    state: Mapped[str] = mapped_column(String(16))
    lease: Mapped[str | None] = mapped_column("claim", String(32), unique=True)
    attempts: Mapped[int]
    owner: Mapped[str]
    host: Mapped[str]
    machine: Mapped[str]
    pid: Mapped[int]
    pid_started: Mapped[int] = mapped_column(BigInteger)
    heartbeat_at: Mapped[float | None]
    options: Mapped[dict[str, Any] | None]
    value: Mapped[float | None]
    feasible: Mapped[bool | None]
    gtf_ate: Mapped[float | None]
    standard_error: Mapped[float | None]
    ci_low: Mapped[float | None]
    ci_high: Mapped[float | None]
    coverage: Mapped[float | None]
    collapsed_rate: Mapped[float | None]
    clean_runs: Mapped[int]
    noisy_runs: Mapped[int]
    wall_s: Mapped[float]
    started_at: Mapped[float]
    finished_at: Mapped[float | None]
    message: Mapped[str]
    detail: Mapped[dict[str, Any]] = mapped_column(deferred=True)


class Run(Base):
    """One finished run of a pipeline: what identifies it and how it ended."""

    __tablename__ = "gtf_run"

    id: Mapped[int] = mapped_column(primary_key=True)
    key: Mapped[str] = mapped_column(String(64), unique=True)
    pipeline: Mapped[str]
    version: Mapped[str]
    settings: Mapped[dict[str, Any]]
    options: Mapped[dict[str, Any]]
    sequence_fingerprint: Mapped[str] = mapped_column(String(64))
    kind: Mapped[str] = mapped_column(String(16))
    index: Mapped[int] = mapped_column("index_", key="index")
    noise_sigma: Mapped[float]
    noise_seed: Mapped[int] = mapped_column(Seed)
    seed: Mapped[int] = mapped_column(Seed)
    threads: Mapped[int]
    status: Mapped[str] = mapped_column(String(16))
    error: Mapped[str]
    started_at: Mapped[float]
    wall_s: Mapped[float]
    peak_memory_bytes: Mapped[int] = mapped_column(BigInteger)
    host: Mapped[str]
    versions: Mapped[dict[str, Any]]
    num_frames: Mapped[int]
    num_poses: Mapped[int]
    diagnostics: Mapped[dict[str, Any]]
    trajectory_digest: Mapped[str] = mapped_column(String(64))


class RunOutput(Base):
    """The large part of a run: its trajectory and the end of its log."""

    __tablename__ = "gtf_run_output"

    run_id: Mapped[int] = mapped_column(_owned_by("gtf_run.id"), primary_key=True)
    trajectory: Mapped[bytes] = mapped_column(LargeBinary)
    log: Mapped[str]


class TrialRun(Base):
    """Say which run serves which trial, as which copy of which sequence; ``reused`` runs were not made for it."""

    __tablename__ = "gtf_trial_run"

    trial_id: Mapped[int] = mapped_column(_owned_by("gtf_trial.id"), primary_key=True)
    sequence_name: Mapped[str] = mapped_column(primary_key=True)
    kind: Mapped[str] = mapped_column(String(16), primary_key=True)
    index: Mapped[int] = mapped_column("index_", key="index", primary_key=True)
    run_id: Mapped[int] = mapped_column(_owned_by("gtf_run.id"), index=True)
    reused: Mapped[bool]


class Validation(Base):
    """The side metric of one trial on one sequence; only reports read it.

    The column ``ate`` is named after the first side metric that there was; ``metrics`` says which one it holds.
    """

    __tablename__ = "gtf_validation"

    trial_id: Mapped[int] = mapped_column(_owned_by("gtf_trial.id"), primary_key=True)
    sequence_name: Mapped[str] = mapped_column(primary_key=True)
    value: Mapped[float | None] = mapped_column("ate")
    metrics: Mapped[dict[str, Any]]


class Confirmation(Base):
    """One re-evaluation of a study's best settings with fresh seeds."""

    __tablename__ = "gtf_confirmation"

    id: Mapped[int] = mapped_column(primary_key=True)
    study_id: Mapped[int] = mapped_column(_owned_by("gtf_study.id"), index=True)
    created_at: Mapped[float]
    definition: Mapped[dict[str, Any]]
    result: Mapped[dict[str, Any]]
    verdict: Mapped[str]
