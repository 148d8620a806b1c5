"""jobs whose trials are made in pages

Revision ID: 0017
Revises: 0016
"""

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None

UNFINISHED = sa.text("trials_made IS NOT NULL AND (state IN ('queued', 'running') OR outcomes IS NULL)")


def upgrade() -> None:
    # Of the jobs that are there all trials exist, which null says.
    op.add_column("job", sa.Column("trials_made", sa.Integer(), nullable=True))
    op.create_index("ix_job_unfinished", "job", ["number"], sqlite_where=UNFINISHED, postgresql_where=UNFINISHED)


def downgrade() -> None:
    op.drop_index("ix_job_unfinished", "job")
    with op.batch_alter_table("job") as batch_op:
        batch_op.drop_column("trials_made")
