"""robots that differ: objects, identifications on one robot, and what only the simulation knows of a trial

Revision ID: 0002
Revises: 0001
"""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

NAMED_JOBS = 5


def upgrade() -> None:
    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.alter_column("policy", existing_type=sa.String(length=64), nullable=True)
        batch_op.alter_column("policy_name", existing_type=sa.String(length=100), nullable=True)
        # Jobs that are there already were all done with the cube, on any robot.
        batch_op.add_column(sa.Column("object", sa.String(length=32), nullable=False, server_default="cube"))
        batch_op.add_column(sa.Column("object_scale", sa.Float(), nullable=False, server_default="1.0"))
        batch_op.add_column(sa.Column("robot", sa.String(length=40), nullable=True))
        batch_op.add_column(sa.Column("any_robot", sa.Boolean(), nullable=False, server_default=sa.false()))

    with op.batch_alter_table("trial", schema=None) as batch_op:
        batch_op.add_column(sa.Column("excitation", sa.String(length=32), nullable=True))
        batch_op.add_column(sa.Column("truth_sha256", sa.String(length=64), nullable=True))

    with op.batch_alter_table("attempt", schema=None) as batch_op:
        batch_op.add_column(sa.Column("truth_sha256", sa.String(length=64), nullable=True))


def downgrade() -> None:
    _refuse_to_lose()
    with op.batch_alter_table("attempt", schema=None) as batch_op:
        batch_op.drop_column("truth_sha256")

    with op.batch_alter_table("trial", schema=None) as batch_op:
        batch_op.drop_column("truth_sha256")
        batch_op.drop_column("excitation")

    with op.batch_alter_table("job", schema=None) as batch_op:
        for name in ("any_robot", "robot", "object_scale", "object"):
            batch_op.drop_column(name)
        batch_op.alter_column("policy_name", existing_type=sa.String(length=100), nullable=False)
        batch_op.alter_column("policy", existing_type=sa.String(length=64), nullable=False)


def _refuse_to_lose() -> None:
    """Raise an error if there are jobs that the first form cannot hold: it has the cube alone, and no identifications."""
    job = sa.table("job", *(sa.column(name) for name in ("number", "job_id", "policy", "object", "object_scale")))
    beyond = sa.or_(job.c.policy.is_(None), job.c.object != "cube", job.c.object_scale != 1.0)
    found = op.get_bind().execute(sa.select(job.c.job_id).where(beyond).order_by(job.c.number)).scalars().all()
    if found:
        named = ", ".join(found[:NAMED_JOBS]) + (f" and {len(found) - NAMED_JOBS} more" if len(found) > NAMED_JOBS else "")
        raise ValueError(
            f"the form 0001 cannot hold {len(found)} jobs with another object than the cube or without a policy ({named}); "
            "nothing was changed. Go back to a copy of the database from before, or delete these jobs from a copy first"
        )
