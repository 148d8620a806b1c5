"""who of several dispatchers gives leases

Revision ID: 0018
Revises: 0017
"""

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.create_table(
        "leader",
        sa.Column("role", sa.String(20), primary_key=True),
        sa.Column("holder", sa.String(40)),
        sa.Column("until_s", sa.Float(), nullable=False),
    )


def downgrade() -> None:
    op.drop_table("leader")
