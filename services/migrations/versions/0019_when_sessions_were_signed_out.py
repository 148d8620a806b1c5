"""when a session was signed out, so that processes read of each other's only the new ones

Revision ID: 0019
Revises: 0018
"""

import sqlalchemy as sa
from alembic import op

revision = "0019"
down_revision = "0018"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("signed_out") as batch_op:
        batch_op.add_column(sa.Column("at_s", sa.Float()))
    op.create_index("ix_signed_out_at_s", "signed_out", ["at_s"])


def downgrade() -> None:
    op.drop_index("ix_signed_out_at_s", "signed_out")
    with op.batch_alter_table("signed_out") as batch_op:
        batch_op.drop_column("at_s")
