"""What people say of attempts and trainees: ratings, bookmarks, courses."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"


def upgrade() -> None:
    """Make the table."""
    op.create_table(
        "notes",
        sa.Column("id", sa.Integer(), nullable=False),
        sa.Column("trainee_id", sa.Integer(), nullable=False),
        sa.Column("attempt_id", sa.Integer()),
        sa.Column("kind", sa.String(16), nullable=False),
        sa.Column("by", sa.String(64), nullable=False),
        sa.Column("at_ns", sa.BigInteger(), nullable=False),
        sa.Column("data", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_notes"),
        sa.ForeignKeyConstraint(["trainee_id"], ["trainees.id"], name="fk_notes_trainee_id", ondelete="CASCADE"),
        sa.ForeignKeyConstraint(["attempt_id"], ["attempts.id"], name="fk_notes_attempt_id", ondelete="CASCADE"),
    )
    op.create_index("ix_notes_trainee_id", "notes", ["trainee_id"])
    op.create_index("ix_notes_attempt_id", "notes", ["attempt_id"])


def downgrade() -> None:
    """Remove the table."""
    op.drop_table("notes")
