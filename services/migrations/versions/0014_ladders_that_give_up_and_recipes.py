"""ladders whose rungs may be given up, rewards of checkpoints, and recipes of trainings

Revision ID: 0014
Revises: 0013
"""

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None

SQLITE_RACES, POSTGRESQL_RACES = sa.text("is_racing = 1"), sa.text("is_racing")


def upgrade() -> None:
    op.add_column("ladder", sa.Column("ends", sa.String(16), nullable=True))
    op.add_column("ladder", sa.Column("is_racing", sa.Boolean(), nullable=False, server_default=sa.false()))
    op.create_index("ix_ladder_racing", "ladder", ["number"], sqlite_where=SQLITE_RACES, postgresql_where=POSTGRESQL_RACES)
    op.add_column("rung", sa.Column("training_reward", sa.Float(), nullable=True))
    op.add_column("rung", sa.Column("given_up", sa.Boolean(), nullable=False, server_default=sa.false()))
    op.add_column("job", sa.Column("recipe", sa.Text(), nullable=True))
    op.add_column("job", sa.Column("training_seed", sa.BigInteger(), nullable=True))
    op.add_column("job", sa.Column("outcomes", sa.Text(), nullable=True))
    _fill_outcomes()


def _fill_outcomes() -> None:
    """Of the jobs that have ended, as ``services/jobs/outcomes.py`` does it for those that end from now on."""
    connection = op.get_bind()
    ended = sa.text(
        "SELECT number, state, trials, counted_trials FROM job "
        "WHERE policy IS NOT NULL AND state IN ('succeeded', 'failed', 'cancelled')"
    )
    of_job = sa.text("SELECT state, substr(outcome, 1, 19) AS begins FROM trial WHERE job_number = :number ORDER BY ordinal")
    keep = sa.text("UPDATE job SET outcomes = :outcomes WHERE number = :number")
    for job in connection.execute(ended).all():
        rows = connection.execute(of_job, {"number": job.number}).all()[: job.counted_trials or job.trials]
        told = "".join(
            "1" if row.state == "done" and row.begins == '{"kind":"succeeded"' else "0"
            for row in rows
            if row.state == "done" or job.state == "cancelled"
        )
        connection.execute(keep, {"outcomes": told, "number": job.number})


def downgrade() -> None:
    for table, columns in (("job", ("outcomes", "training_seed", "recipe")), ("rung", ("given_up", "training_reward"))):
        with op.batch_alter_table(table, schema=None) as batch_op:
            for column in columns:
                batch_op.drop_column(column)
    op.drop_index("ix_ladder_racing", table_name="ladder")
    with op.batch_alter_table("ladder", schema=None) as batch_op:
        batch_op.drop_column("is_racing")
        batch_op.drop_column("ends")
