"""a canary: a policy that idle robots try from time to time

Revision ID: 0007
Revises: 0006
"""

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "canary",
        sa.Column("number", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("policy", sa.String(length=64), nullable=False),
        sa.Column("task", sa.String(length=32), nullable=False),
        sa.Column("trials", sa.Integer(), nullable=False),
        sa.Column("at_least", sa.Float(), nullable=False),
        sa.Column("every_s", sa.Float(), nullable=False),
        sa.Column("seed", sa.BigInteger(), nullable=False),
        sa.Column("set_by", sa.String(length=64), nullable=False),
        sa.Column("set_at", sa.String(length=40), nullable=False),
        sa.ForeignKeyConstraint(["policy"], ["policy.digest"], name=op.f("fk_canary_policy")),
        sa.PrimaryKeyConstraint("number", name=op.f("pk_canary")),
    )
    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.add_column(sa.Column("canary_at_least", sa.Float(), nullable=True))
    with op.batch_alter_table("robot", schema=None) as batch_op:
        batch_op.add_column(sa.Column("canary_s", sa.Float(), nullable=True))


def downgrade() -> None:
    with op.batch_alter_table("robot", schema=None) as batch_op:
        batch_op.drop_column("canary_s")
    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.drop_column("canary_at_least")
    op.drop_table("canary")
