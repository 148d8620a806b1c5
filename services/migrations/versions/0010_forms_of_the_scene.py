"""forms of the scene, so that results of two are not put together

Revision ID: 0010
Revises: 0009
"""

import sqlalchemy as sa
from alembic import op

revision = "0010"
down_revision = "0009"
branch_labels = None
depends_on = None


def upgrade() -> None:
    with op.batch_alter_table("physics", schema=None) as batch_op:
        batch_op.add_column(sa.Column("form", sa.String(length=40), nullable=False, server_default="0.1.0"))
        batch_op.drop_constraint(op.f("uq_physics_name"), type_="unique")
        batch_op.create_unique_constraint(op.f("uq_physics_name"), ["name", "digest", "form"])


def downgrade() -> None:
    with op.batch_alter_table("physics", schema=None) as batch_op:
        batch_op.drop_constraint(op.f("uq_physics_name"), type_="unique")
        batch_op.create_unique_constraint(op.f("uq_physics_name"), ["name", "digest"])
        batch_op.drop_column("form")
