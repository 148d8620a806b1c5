"""the physics of robots and jobs, so that a leaderboard puts together what belongs together

Revision ID: 0008
Revises: 0007
"""

import sqlalchemy as sa
from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

NUMBER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
BOARD = ["task", "object", "object_scale", "physics", "policy"]


def upgrade() -> None:
    op.create_table(
        "physics",
        sa.Column("number", NUMBER, autoincrement=True, nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("digest", sa.String(length=64), nullable=False),
        sa.Column("first_told_at", sa.String(length=40), nullable=False),
        sa.Column("told_s", sa.Float(), nullable=False),
        sa.PrimaryKeyConstraint("number", name=op.f("pk_physics")),
        sa.UniqueConstraint("name", "digest", name=op.f("uq_physics_name")),
    )
    with op.batch_alter_table("robot", schema=None) as batch_op:
        batch_op.add_column(sa.Column("physics", NUMBER, nullable=True))
        batch_op.create_foreign_key(op.f("fk_robot_physics"), "physics", ["physics"], ["number"])
    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.add_column(sa.Column("physics", NUMBER, nullable=True))
        batch_op.add_column(sa.Column("physics_mixed", sa.Boolean(), nullable=False, server_default=sa.false()))
        batch_op.create_foreign_key(op.f("fk_job_physics"), "physics", ["physics"], ["number"])
        batch_op.create_index("ix_job_board", BOARD)


def downgrade() -> None:
    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.drop_index("ix_job_board")
        batch_op.drop_constraint(op.f("fk_job_physics"), type_="foreignkey")
        batch_op.drop_column("physics_mixed")
        batch_op.drop_column("physics")
    with op.batch_alter_table("robot", schema=None) as batch_op:
        batch_op.drop_constraint(op.f("fk_robot_physics"), type_="foreignkey")
        batch_op.drop_column("physics")
    op.drop_table("physics")
