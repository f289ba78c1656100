"""Make the first tables."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    _create_study()
    _create_sequence()
    _create_trial()
    _create_run()
    _create_run_output()
    _create_trial_run()
    _create_validation()
    _create_confirmation()


def _create_study() -> None:
    op.create_table(
        "gtf_study",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("optuna_study_id", sa.Integer(), nullable=False),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("definition", sa.Text(), nullable=False),
        sa.Column("resolved", sa.Text(), nullable=False),
        sa.Column("root", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_gtf_study"),
        sa.UniqueConstraint("name", name="uq_gtf_study_name"),
    )


def _create_sequence() -> None:
    op.create_table(
        "gtf_sequence",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("study_id", sa.Integer(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("path", sa.Text(), nullable=False),
        sa.Column("layout", sa.Text(), nullable=False),
        sa.Column("fingerprint", sa.String(length=64), nullable=False),
        sa.Column("num_frames", sa.Integer(), nullable=False),
        sa.Column("width", sa.Integer(), nullable=False),
        sa.Column("height", sa.Integer(), nullable=False),
        sa.Column("camera", sa.Text(), nullable=False),
        sa.Column("has_ground_truth", sa.Boolean(), nullable=False),
        sa.Column("info", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(["study_id"], ["gtf_study.id"], name="fk_gtf_sequence_study_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name="pk_gtf_sequence"),
        sa.UniqueConstraint("study_id", "name", name="uq_gtf_sequence_study_id_name"),
    )


def _create_trial() -> None:
    op.create_table(
        "gtf_trial",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("study_id", sa.Integer(), nullable=False),
        sa.Column("ordinal", sa.Integer(), nullable=False),
        sa.Column("optuna_trial_id", sa.Integer()),
        sa.Column("optuna_number", sa.Integer()),
        sa.Column("state", sa.String(length=16), nullable=False),
        sa.Column("claim", sa.String(length=32)),
        sa.Column("attempts", sa.Integer(), nullable=False),
        sa.Column("owner", sa.Text(), nullable=False),
        sa.Column("host", sa.Text(), nullable=False),
        sa.Column("machine", sa.Text(), nullable=False),
        sa.Column("pid", sa.Integer(), nullable=False),
        sa.Column("pid_started", sa.BigInteger(), nullable=False),
        sa.Column("heartbeat_at", sa.Double()),
        sa.Column("options", sa.Text()),
        sa.Column("value", sa.Double()),
        sa.Column("feasible", sa.Boolean()),
        sa.Column("gtf_ate", sa.Double()),
        sa.Column("standard_error", sa.Double()),
        sa.Column("ci_low", sa.Double()),
        sa.Column("ci_high", sa.Double()),
        sa.Column("coverage", sa.Double()),
        sa.Column("collapsed_rate", sa.Double()),
        sa.Column("clean_runs", sa.Integer(), nullable=False),
        sa.Column("noisy_runs", sa.Integer(), nullable=False),
        sa.Column("wall_s", sa.Double(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=False),
        sa.Column("finished_at", sa.Double()),
        sa.Column("message", sa.Text(), nullable=False),
        sa.Column("detail", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(["study_id"], ["gtf_study.id"], name="fk_gtf_trial_study_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("id", name="pk_gtf_trial"),
        sa.UniqueConstraint("claim", name="uq_gtf_trial_claim"),
        sa.UniqueConstraint("study_id", "ordinal", name="uq_gtf_trial_study_id_ordinal"),
    )
    op.create_index("ix_gtf_trial_study_id_state", "gtf_trial", ["study_id", "state"])


def _create_run() -> None:
    op.create_table(
        "gtf_run",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("key", sa.String(length=64), nullable=False),
        sa.Column("pipeline", sa.Text(), nullable=False),
        sa.Column("version", sa.Text(), nullable=False),
        sa.Column("settings", sa.Text(), nullable=False),
        sa.Column("options", sa.Text(), nullable=False),
        sa.Column("sequence_fingerprint", sa.String(length=64), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("index_", sa.Integer(), nullable=False),
        sa.Column("noise_sigma", sa.Double(), nullable=False),
        sa.Column("noise_seed", sa.String(length=20), nullable=False),
        sa.Column("seed", sa.String(length=20), nullable=False),
        sa.Column("threads", sa.Integer(), nullable=False),
        sa.Column("status", sa.String(length=16), nullable=False),
        sa.Column("error", sa.Text(), nullable=False),
        sa.Column("started_at", sa.Double(), nullable=False),
        sa.Column("wall_s", sa.Double(), nullable=False),
        sa.Column("peak_memory_bytes", sa.BigInteger(), nullable=False),
        sa.Column("host", sa.Text(), nullable=False),
        sa.Column("versions", sa.Text(), nullable=False),
        sa.Column("num_frames", sa.Integer(), nullable=False),
        sa.Column("num_poses", sa.Integer(), nullable=False),
        sa.Column("diagnostics", sa.Text(), nullable=False),
        sa.Column("trajectory_digest", sa.String(length=64), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_gtf_run"),
        sa.UniqueConstraint("key", name="uq_gtf_run_key"),
    )


def _create_run_output() -> None:
    op.create_table(
        "gtf_run_output",
        sa.Column("run_id", sa.Integer(), nullable=False),
        sa.Column("trajectory", sa.LargeBinary(), nullable=False),
        sa.Column("log", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(["run_id"], ["gtf_run.id"], name="fk_gtf_run_output_run_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("run_id", name="pk_gtf_run_output"),
    )


def _create_trial_run() -> None:
    op.create_table(
        "gtf_trial_run",
        sa.Column("trial_id", sa.Integer(), nullable=False),
        sa.Column("sequence_name", sa.Text(), nullable=False),
        sa.Column("kind", sa.String(length=16), nullable=False),
        sa.Column("index_", sa.Integer(), nullable=False),
        sa.Column("run_id", sa.Integer(), nullable=False),
        sa.Column("reused", sa.Boolean(), nullable=False),
        sa.ForeignKeyConstraint(["run_id"], ["gtf_run.id"], name="fk_gtf_trial_run_run_id", ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["trial_id"], ["gtf_trial.id"], name="fk_gtf_trial_run_trial_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("trial_id", "sequence_name", "kind", "index_", name="pk_gtf_trial_run"),
    )
    op.create_index("ix_gtf_trial_run_run_id", "gtf_trial_run", ["run_id"])


def _create_validation() -> None:
    op.create_table(
        "gtf_validation",
        sa.Column("trial_id", sa.Integer(), nullable=False),
        sa.Column("sequence_name", sa.Text(), nullable=False),
        sa.Column("ate", sa.Double()),
        sa.Column("metrics", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(["trial_id"], ["gtf_trial.id"], name="fk_gtf_validation_trial_id", ondelete="CASCADE"),
        sa.PrimaryKeyConstraint("trial_id", "sequence_name", name="pk_gtf_validation"),
    )


def _create_confirmation() -> None:
    op.create_table(
        "gtf_confirmation",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("study_id", sa.Integer(), nullable=False),
        sa.Column("created_at", sa.Double(), nullable=False),
        sa.Column("definition", sa.Text(), nullable=False),
        sa.Column("result", sa.Text(), nullable=False),
        sa.Column("verdict", sa.Text(), nullable=False),
        sa.ForeignKeyConstraint(
            ["study_id"], ["gtf_study.id"], name="fk_gtf_confirmation_study_id", ondelete="CASCADE"
        ),
        sa.PrimaryKeyConstraint("id", name="pk_gtf_confirmation"),
    )
    op.create_index("ix_gtf_confirmation_study_id", "gtf_confirmation", ["study_id"])
