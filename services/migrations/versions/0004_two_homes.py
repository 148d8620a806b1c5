"""two homes: users take turns, a robot has one lease, and what several processes count is counted in the database

Revision ID: 0004
Revises: 0003
"""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None

LEASED = sa.text("state IN ('leased', 'running')")
UNDRAWN = sa.text("state = 'queued' AND first_choice IS NULL")
PINNED = sa.text("robot IS NOT NULL AND state IN ('queued', 'running')")
OWNERS = "UPDATE trial SET owner = (SELECT job.owner FROM job WHERE job.number = trial.job_number)"
DONE = (
    "UPDATE robot SET trials_done = "
    "(SELECT count(*) FROM attempt WHERE attempt.robot = robot.robot AND attempt.state = 'accepted')"
)


def upgrade() -> None:
    op.create_table(
        "turn",
        sa.Column("owner", sa.String(length=64), nullable=False),
        sa.Column("served_s", sa.Float(), nullable=False),
        sa.PrimaryKeyConstraint("owner", name=op.f("pk_turn")),
    )
    with op.batch_alter_table("robot", schema=None) as batch_op:
        batch_op.add_column(sa.Column("trials_done", sa.Integer(), nullable=False, server_default="0"))
        batch_op.add_column(sa.Column("faults_in_a_row", sa.Integer(), nullable=False, server_default="0"))
        batch_op.add_column(sa.Column("withdrawn", sa.Text(), nullable=True))
    op.execute(DONE)

    op.drop_index("ix_trial_queue", "trial")
    with op.batch_alter_table("trial", schema=None) as batch_op:
        batch_op.add_column(sa.Column("owner", sa.String(length=64), nullable=False, server_default=""))
    op.execute(OWNERS)
    op.create_index("ix_trial_queue", "trial", ["state", "first_choice", "owner", "job_number", "ordinal"])
    undrawn = ["owner", "job_number", "ordinal"]
    op.create_index("ix_trial_undrawn", "trial", undrawn, sqlite_where=UNDRAWN, postgresql_where=UNDRAWN)
    op.create_index("ix_trial_lease", "trial", ["robot"], unique=True, sqlite_where=LEASED, postgresql_where=LEASED)
    op.create_index("ix_attempt_truth_sha256", "attempt", ["truth_sha256"])
    op.create_index("ix_job_pinned", "job", ["state", "robot"], sqlite_where=PINNED, postgresql_where=PINNED)


def downgrade() -> None:
    op.drop_index("ix_job_pinned", "job")
    op.drop_index("ix_attempt_truth_sha256", "attempt")
    op.drop_index("ix_trial_lease", "trial")
    op.drop_index("ix_trial_undrawn", "trial")
    op.drop_index("ix_trial_queue", "trial")
    with op.batch_alter_table("trial", schema=None) as batch_op:
        batch_op.drop_column("owner")
    op.create_index("ix_trial_queue", "trial", ["state", "first_choice", "job_number", "ordinal"])
    with op.batch_alter_table("robot", schema=None) as batch_op:
        for name in ("withdrawn", "faults_in_a_row", "trials_done"):
            batch_op.drop_column(name)
    op.drop_table("turn")
