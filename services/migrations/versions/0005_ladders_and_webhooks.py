"""ladders of jobs, and webhooks that are called at a job's end

Revision ID: 0005
Revises: 0004
"""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

NUMBER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.create_table(
        "ladder",
        sa.Column("number", NUMBER, autoincrement=True, nullable=False),
        sa.Column("ladder_id", sa.String(length=20), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("created_at", sa.String(length=40), nullable=False),
        sa.Column("idempotency_key", sa.String(length=200), nullable=True),
        sa.Column("request_sha256", sa.String(length=64), nullable=True),
        sa.PrimaryKeyConstraint("number", name=op.f("pk_ladder")),
        sa.UniqueConstraint("ladder_id", name=op.f("uq_ladder_ladder_id")),
        sa.UniqueConstraint("owner", "idempotency_key", name=op.f("uq_ladder_owner")),
    )
    op.create_table(
        "rung",
        sa.Column("ladder_number", NUMBER, nullable=False),
        sa.Column("ordinal", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("step", sa.Float(), nullable=False),
        sa.Column("job_number", NUMBER, nullable=False),
        sa.ForeignKeyConstraint(["ladder_number"], ["ladder.number"], name=op.f("fk_rung_ladder_number")),
        sa.ForeignKeyConstraint(["job_number"], ["job.number"], name=op.f("fk_rung_job_number")),
        sa.PrimaryKeyConstraint("ladder_number", "ordinal", name=op.f("pk_rung")),
    )
    op.create_table(
        "webhook",
        sa.Column("job_number", NUMBER, autoincrement=False, nullable=False),
        sa.Column("url", sa.String(length=500), nullable=False),
        sa.Column("tries", sa.Integer(), nullable=False),
        sa.Column("due_s", sa.Float(), nullable=True),
        sa.Column("said", sa.Text(), nullable=True),
        sa.ForeignKeyConstraint(["job_number"], ["job.number"], name=op.f("fk_webhook_job_number")),
        sa.PrimaryKeyConstraint("job_number", name=op.f("pk_webhook")),
    )
    op.create_index("ix_webhook_due_s", "webhook", ["due_s"])


def downgrade() -> None:
    op.drop_index("ix_webhook_due_s", "webhook")
    for table in ("webhook", "rung", "ladder"):
        op.drop_table(table)
