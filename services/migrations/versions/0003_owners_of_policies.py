"""owners of policies, and tokens of single robots

Revision ID: 0003
Revises: 0002
"""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "policy_owner",
        sa.Column("number", sa.BigInteger().with_variant(sa.Integer(), "sqlite"), autoincrement=True, nullable=False),
        sa.Column("digest", sa.String(length=64), nullable=False),
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("created_at", sa.String(length=40), nullable=False),
        sa.ForeignKeyConstraint(["digest"], ["policy.digest"], name=op.f("fk_policy_owner_digest")),
        sa.PrimaryKeyConstraint("number", name=op.f("pk_policy_owner")),
        sa.UniqueConstraint("owner", "digest", name=op.f("uq_policy_owner_owner")),
    )
    _name_owners()
    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.create_index("ix_job_owner_state", ["owner", "state"], unique=False)

    with op.batch_alter_table("token", schema=None) as batch_op:
        batch_op.add_column(sa.Column("robot", sa.String(length=40), nullable=True))
        batch_op.add_column(sa.Column("parent", sa.String(length=20), nullable=True))


def downgrade() -> None:
    # The older form knows no tokens of single robots and would take them for tokens of the whole farm.
    token = sa.table("token", sa.column("robot"))
    op.execute(sa.delete(token).where(token.c.robot.is_not(None)))
    with op.batch_alter_table("token", schema=None) as batch_op:
        batch_op.drop_column("parent")
        batch_op.drop_column("robot")

    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.drop_index("ix_job_owner_state")

    op.drop_table("policy_owner")


def _name_owners() -> None:
    """Policies that are there already belong to who sent them and to who has run them: until now everybody could."""
    policy = sa.table("policy", *(sa.column(name) for name in ("number", "digest", "owner", "created_at")))
    job = sa.table("job", *(sa.column(name) for name in ("number", "policy", "owner", "created_at")))
    policy_owner = sa.table("policy_owner", *(sa.column(name) for name in ("digest", "owner", "created_at")))
    into = sa.insert(policy_owner)
    senders = sa.select(policy.c.digest, policy.c.owner, policy.c.created_at).order_by(policy.c.number)
    op.execute(into.from_select(["digest", "owner", "created_at"], senders))
    known = sa.exists().where(policy_owner.c.digest == job.c.policy, policy_owner.c.owner == job.c.owner)
    users = (
        sa.select(job.c.policy, job.c.owner, sa.func.min(job.c.created_at))
        .where(job.c.policy.is_not(None), ~known)
        .group_by(job.c.policy, job.c.owner)
        .order_by(sa.func.min(job.c.number))
    )
    op.execute(into.from_select(["digest", "owner", "created_at"], users))
