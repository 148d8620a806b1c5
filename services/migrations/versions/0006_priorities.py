"""priorities: users take turns within a priority

Revision ID: 0006
Revises: 0005
"""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

UNDRAWN = sa.text("state = 'queued' AND first_choice IS NULL")
NORMAL = "1"
QUEUE = ["state", "first_choice", "owner", "job_number", "ordinal"]
WAITING = ["owner", "job_number", "ordinal"]


def upgrade() -> None:
    _drop_indexes()
    for table in ("job", "trial"):
        with op.batch_alter_table(table, schema=None) as batch_op:
            batch_op.add_column(sa.Column("priority", sa.Integer(), nullable=False, server_default=NORMAL))
    _make_indexes([*QUEUE[:2], "priority", *QUEUE[2:]], ["priority", *WAITING])


def downgrade() -> None:
    _drop_indexes()
    for table in ("trial", "job"):
        with op.batch_alter_table(table, schema=None) as batch_op:
            batch_op.drop_column("priority")
    _make_indexes(QUEUE, WAITING)


def _drop_indexes() -> None:
    for name in ("ix_trial_undrawn", "ix_trial_queue"):
        op.drop_index(name, "trial")


def _make_indexes(queue: list[str], undrawn: list[str]) -> None:
    op.create_index("ix_trial_queue", "trial", queue)
    op.create_index("ix_trial_undrawn", "trial", undrawn, sqlite_where=UNDRAWN, postgresql_where=UNDRAWN)
