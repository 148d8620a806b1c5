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
    # Identifications have no place in the first form.
    jobs = "SELECT number FROM job WHERE policy IS NULL"
    trials = f"SELECT trial_id FROM trial WHERE job_number IN ({jobs})"  # noqa: S608 - no outside text in it
    op.execute(f"DELETE FROM attempt WHERE trial_id IN ({trials})")  # noqa: S608
    for table in ("trial", "event", "report"):
        op.execute(f"DELETE FROM {table} WHERE job_number IN ({jobs})")  # noqa: S608
    op.execute("DELETE FROM job WHERE policy IS NULL")
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
