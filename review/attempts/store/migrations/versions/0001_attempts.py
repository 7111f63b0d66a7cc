"""Trainees and attempts."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None


def upgrade() -> None:
    """Make the tables."""
    op.create_table(
        "trainees",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("pseudonym", sa.String(64), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_trainees"),
        sa.UniqueConstraint("pseudonym", name="uq_trainees_pseudonym"),
    )
    op.create_table(
        "attempts",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("trainee_id", sa.Integer(), nullable=False),
        sa.Column("key", sa.String(64), nullable=False),
        sa.Column("scenario", sa.String(64), nullable=False),
        sa.Column("began_ns", sa.BigInteger(), nullable=False),
        sa.Column("outcome", sa.String(16), nullable=False),
        sa.Column("counts", sa.Boolean(), nullable=False),
        sa.Column("time_s", sa.Float(), nullable=False),
        sa.Column("total", sa.Float()),
        sa.Column("percent", sa.Float()),
        sa.Column("errors", sa.Integer(), nullable=False),
        sa.Column("critical", sa.Integer(), nullable=False),
        sa.Column("recording", sa.String(4096), nullable=False),
        sa.Column("assessment", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_attempts"),
        sa.UniqueConstraint("key", name="uq_attempts_key"),
        sa.ForeignKeyConstraint(["trainee_id"], ["trainees.id"], name="fk_attempts_trainee_id", ondelete="CASCADE"),
    )
    op.create_index("ix_attempts_trainee_id_began_ns", "attempts", ["trainee_id", "began_ns"])
    op.create_index("ix_attempts_began_ns", "attempts", ["began_ns"])


def downgrade() -> None:
    """Remove the tables."""
    op.drop_table("attempts")
    op.drop_table("trainees")
