"""questions about why trials failed, with their answers

Revision ID: 0013
Revises: 0012
"""

import sqlalchemy as sa
from alembic import op

revision = "0013"
down_revision = "0012"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "why",
        sa.Column("trial_id", sa.String(30), sa.ForeignKey("trial.trial_id"), nullable=False),
        sa.Column("owner", sa.String(64), nullable=False),
        sa.Column("robot", sa.String(40), nullable=False),
        sa.Column("counted", sa.Boolean(), nullable=False),
        sa.Column("state", sa.String(16), nullable=False),
        sa.Column("asked_s", sa.Float(), nullable=False),
        sa.Column("due_s", sa.Float(), nullable=False),
        sa.Column("tries", sa.Integer(), nullable=False),
        sa.Column("answer", sa.Text()),
        sa.Column("problem", sa.Text()),
        sa.PrimaryKeyConstraint("trial_id"),
    )
    op.create_index("ix_why_open", "why", ["state", "due_s"])
    op.create_index("ix_why_budget", "why", ["owner", "robot"])


def downgrade() -> None:
    op.drop_table("why")
