"""shared reports and trials, names and notes of jobs

Revision ID: 0016
Revises: 0015
"""

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "share",
        sa.Column("number", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), primary_key=True, autoincrement=True),
        sa.Column("share_id", sa.String(20), nullable=False),
        sa.Column("secret_sha256", sa.String(64), nullable=False),
        sa.Column("job_number", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), nullable=False),
        sa.Column("trial_id", sa.String(30)),
        sa.Column("at_s", sa.Float()),
        sa.Column("owner", sa.String(64), nullable=False),
        sa.Column("token_id", sa.String(20), nullable=False),
        sa.Column("created_at", sa.String(40), nullable=False),
        sa.Column("expires_s", sa.Float(), nullable=False),
        sa.Column("revoked_at", sa.String(40)),
        sa.ForeignKeyConstraint(["job_number"], ["job.number"], name="fk_share_job_number"),
        sa.ForeignKeyConstraint(["trial_id"], ["trial.trial_id"], name="fk_share_trial_id"),
        sa.UniqueConstraint("share_id", name="uq_share_share_id"),
        sa.UniqueConstraint("secret_sha256", name="uq_share_secret_sha256"),
    )
    op.create_index("ix_share_owner", "share", ["owner"])
    with op.batch_alter_table("job") as batch_op:
        batch_op.add_column(sa.Column("name", sa.Text()))
        batch_op.add_column(sa.Column("note", sa.Text()))


def downgrade() -> None:
    with op.batch_alter_table("job") as batch_op:
        batch_op.drop_column("note")
        batch_op.drop_column("name")
    op.drop_index("ix_share_owner", "share")
    op.drop_table("share")
