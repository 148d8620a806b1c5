"""questions that end jobs, and goals that users bring

Revision ID: 0011
Revises: 0010
"""

import sqlalchemy as sa
from alembic import op

revision = "0011"
down_revision = "0010"
branch_labels = None
depends_on = None

NUMBER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
OPEN = sa.text("verdict IS NULL")


def upgrade() -> None:
    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.add_column(sa.Column("judged", sa.Boolean(), nullable=False, server_default=sa.false()))
        batch_op.add_column(sa.Column("counted_trials", sa.Integer(), nullable=True))
        batch_op.add_column(sa.Column("counted_successes", sa.Integer(), nullable=True))
        batch_op.add_column(sa.Column("own_goals", sa.Boolean(), nullable=False, server_default=sa.false()))
    op.add_column("trial", sa.Column("own_goal", sa.Text(), nullable=True))
    op.create_table(
        "question",
        sa.Column("job_number", NUMBER, autoincrement=False, nullable=False),
        sa.Column("against_number", NUMBER, nullable=True),
        sa.Column("is_twin", sa.Boolean(), nullable=False),
        sa.Column("bar", sa.Float(), nullable=True),
        sa.Column("at_least", sa.Float(), nullable=True),
        sa.Column("findable", sa.Text(), nullable=False),
        sa.Column("verdict", sa.String(length=16), nullable=True),
        sa.ForeignKeyConstraint(["job_number"], ["job.number"], name=op.f("fk_question_job_number")),
        sa.ForeignKeyConstraint(["against_number"], ["job.number"], name=op.f("fk_question_against_number")),
        sa.PrimaryKeyConstraint("job_number", name=op.f("pk_question")),
    )
    op.create_index(op.f("ix_question_against_number"), "question", ["against_number"])
    op.create_index("ix_question_open", "question", ["job_number"], sqlite_where=OPEN, postgresql_where=OPEN)


def downgrade() -> None:
    op.drop_table("question")
    with op.batch_alter_table("trial", schema=None) as batch_op:
        batch_op.drop_column("own_goal")
    with op.batch_alter_table("job", schema=None) as batch_op:
        batch_op.drop_column("own_goals")
        batch_op.drop_column("counted_successes")
        batch_op.drop_column("counted_trials")
        batch_op.drop_column("judged")
