"""The tables: policies, their owners, physics, jobs, ladders, webhooks, trials, attempts, events, reports, robots, turns, tokens,
shares.

States are stored as the words of ``api_schemas``; times for people as ISO 8601 text in UTC, times that are compared as
seconds of the farm's clock. Every statement that uses these tables runs on SQLite and on PostgreSQL.
"""

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Dialect,
    Float,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    String,
    Table,
    Text,
    UniqueConstraint,
    text,
)
from sqlalchemy.types import TypeDecorator

from api_schemas.scene_form import FIRST_FORM

metadata = MetaData(
    naming_convention={
        "ix": "ix_%(column_0_label)s",
        "uq": "uq_%(table_name)s_%(column_0_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "pk": "pk_%(table_name)s",
    }
)


class Words(TypeDecorator[str]):
    """Text from outside without NUL, which PostgreSQL refuses: one in an error's text would keep a trial from ending."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, dialect: Dialect) -> str | None:  # noqa: ARG002  SQLAlchemy's signature
        """What is stored."""
        return None if value is None else value.replace("\0", "\ufffd")


# SQLite numbers rows by itself only for a column of exactly the type INTEGER.
NUMBER = BigInteger().with_variant(Integer, "sqlite")
LEASED = "state IN ('leased', 'running')"
UNDRAWN = "state = 'queued' AND first_choice IS NULL"
OPEN = "verdict IS NULL"
NORMAL_RANK = 1
UNFINISHED = "trials_made IS NOT NULL AND (state IN ('queued', 'running') OR outcomes IS NULL)"
PINNED = "robot IS NOT NULL AND state IN ('queued', 'running')"

policy = Table(
    "policy",
    metadata,
    Column("number", NUMBER, primary_key=True, autoincrement=True),
    Column("digest", String(64), nullable=False, unique=True),
    Column("name", Words(100), nullable=False),
    Column("weights_format", String(16), nullable=False),
    Column("weights_sha256", String(64), nullable=False),
    Column("weights_bytes", BigInteger, nullable=False),
    Column("graph_sha256", String(64), nullable=False),
    # 0 for those that came before graphs were counted.
    Column("graph_bytes", BigInteger, nullable=False, default=0),
    Column("manifest", Text, nullable=False),
    Column("warnings", Text, nullable=False),
    Column("owner", String(64), nullable=False),
    Column("created_at", String(40), nullable=False),
)

policy_owner = Table(
    "policy_owner",
    metadata,
    Column("number", NUMBER, primary_key=True, autoincrement=True),
    Column("digest", String(64), ForeignKey("policy.digest"), nullable=False),
    Column("owner", String(64), nullable=False),
    Column("created_at", String(40), nullable=False),
    UniqueConstraint("owner", "digest"),
)

physics = Table(
    "physics",
    metadata,
    Column("number", NUMBER, primary_key=True, autoincrement=True),
    Column("name", Words(100), nullable=False),
    # Of its content and the farm's secret, by which guesses at a farm seed can be checked: shown to nobody.
    Column("digest", String(64), nullable=False),
    # Of the scene.
    Column("form", String(40), nullable=False, default=FIRST_FORM),
    Column("first_told_at", String(40), nullable=False),
    # When a robot with it last joined; the latest is the farm's.
    Column("told_s", Float, nullable=False),
    UniqueConstraint("name", "digest", "form"),
)

job = Table(
    "job",
    metadata,
    Column("number", NUMBER, primary_key=True, autoincrement=True),
    Column("job_id", String(20), nullable=False, unique=True),
    Column("state", String(16), nullable=False, index=True),
    Column("policy", String(64), ForeignKey("policy.digest")),
    Column("policy_name", Words(100)),
    Column("task", String(32), nullable=False),
    Column("object", String(32), nullable=False, default="cube"),
    Column("object_scale", Float, nullable=False, default=1.0),
    # A rank of services/jobs/priority.py; its trials have the same.
    Column("priority", Integer, nullable=False, default=NORMAL_RANK),
    # Of the robots: of the farm when the job was queued, of the first trial's robot when that is done; null if nobody knew.
    Column("physics", NUMBER, ForeignKey("physics.number")),
    # Trials of it were done with other physics besides.
    Column("physics_mixed", Boolean, nullable=False, default=False),
    # Of a canary's job: where the band of a sound robot's success rate began when it was queued.
    Column("canary_at_least", Float),
    # Whether a question ends it; then its report counts the first trials alone, so many of them with success.
    Column("judged", Boolean, nullable=False, default=False),
    Column("counted_trials", Integer),
    Column("counted_successes", Integer),
    # Whether its user brought the goals.
    Column("own_goals", Boolean, nullable=False, default=False),
    # Whether its logs keep the cameras' images.
    Column("images", Boolean, nullable=False, default=False),
    # Of an ended job of a policy: how its counted trials ended, in their order, 1 with success and 0 without.
    Column("outcomes", Text),
    # The training that its policy is one seed of, in the words of its user.
    Column("recipe", Words),
    Column("training_seed", BigInteger),
    # What people call it and remember of it.
    Column("name", Words),
    Column("note", Words),
    # The one robot that runs all trials of the job; where any will do, it is drawn with the first lease.
    Column("robot", String(40)),
    Column("any_robot", Boolean, nullable=False, default=False),
    Column("trials", Integer, nullable=False),
    # Of a large job: how many of its trials exist; null where all were made with it.
    Column("trials_made", Integer),
    Column("seed", BigInteger, nullable=False),
    Column("seed_drawn_by_server", Boolean, nullable=False),
    Column("owner", String(64), nullable=False),
    Column("created_at", String(40), nullable=False),
    # When it was queued, or queued again.
    Column("created_s", Float, nullable=False),
    Column("started_at", String(40)),
    Column("ended_at", String(40)),
    Column("reason", Words),
    Column("cancel_requested", Boolean, nullable=False, default=False),
    Column("trials_done", Integer, nullable=False, default=0),
    Column("trials_active", Integer, nullable=False, default=0),
    Column("successes", Integer, nullable=False, default=0),
    Column("policy_faults", Integer, nullable=False, default=0),
    Column("platform_faults", Integer, nullable=False, default=0),
    Column("last_event", Integer, nullable=False, default=0),
    Column("idempotency_key", String(200)),
    Column("request_sha256", String(64)),
    UniqueConstraint("owner", "idempotency_key"),
    Index("ix_job_owner_state", "owner", "state"),
    Index("ix_job_board", "task", "object", "object_scale", "physics", "policy"),
    Index("ix_job_unfinished", "number", sqlite_where=text(UNFINISHED), postgresql_where=text(UNFINISHED)),
    # Identifications that wait for their robot; the dispatcher looks at them again and again.
    Index("ix_job_pinned", "state", "robot", sqlite_where=text(PINNED), postgresql_where=text(PINNED)),
)

ladder = Table(
    "ladder",
    metadata,
    Column("number", NUMBER, primary_key=True, autoincrement=True),
    Column("ladder_id", String(20), nullable=False, unique=True),
    Column("name", Words(100), nullable=False),
    Column("owner", String(64), nullable=False),
    Column("created_at", String(40), nullable=False),
    Column("idempotency_key", String(200)),
    Column("request_sha256", String(64)),
    # By which rule rungs are given up early, and whether that may still happen.
    Column("ends", String(16)),
    Column("is_racing", Boolean, nullable=False, default=False),
    UniqueConstraint("owner", "idempotency_key"),
    Index("ix_ladder_racing", "number", sqlite_where=text("is_racing = 1"), postgresql_where=text("is_racing")),
)

rung = Table(
    "rung",
    metadata,
    Column("ladder_number", NUMBER, ForeignKey("ladder.number"), primary_key=True),
    Column("ordinal", Integer, primary_key=True, autoincrement=False),
    # Training step, or whatever number the policies of the ladder differ by.
    Column("step", Float, nullable=False),
    # What the training said of it.
    Column("training_reward", Float),
    # Before all of its goals were tried, since others are better.
    Column("given_up", Boolean, nullable=False, default=False),
    Column("job_number", NUMBER, ForeignKey("job.number"), nullable=False),
)

question = Table(
    "question",
    metadata,
    # The job that is run to answer it.
    Column("job_number", NUMBER, ForeignKey("job.number"), primary_key=True, autoincrement=False),
    # The job that it is compared with, and whether that one was queued for the question and ends with it.
    Column("against_number", NUMBER, ForeignKey("job.number"), index=True),
    Column("is_twin", Boolean, nullable=False, default=False),
    # A success rate, and the smallest difference that matters.
    Column("bar", Float),
    Column("at_least", Float),
    Column("findable", Words, nullable=False),
    Column("verdict", String(16)),
    Index("ix_question_open", "job_number", sqlite_where=text(OPEN), postgresql_where=text(OPEN)),
)

webhook = Table(
    "webhook",
    metadata,
    Column("job_number", NUMBER, ForeignKey("job.number"), primary_key=True, autoincrement=False),
    Column("url", String(500), nullable=False),
    Column("tries", Integer, nullable=False, default=0),
    # When to call next, if the job has ended by then; null when nothing is left to do.
    Column("due_s", Float, index=True),
    # What came of the last try.
    Column("said", Words),
)

trial = Table(
    "trial",
    metadata,
    Column("trial_id", String(30), primary_key=True),
    Column("job_number", NUMBER, ForeignKey("job.number"), nullable=False),
    Column("owner", String(64), nullable=False),
    Column("priority", Integer, nullable=False, default=NORMAL_RANK),
    Column("ordinal", Integer, nullable=False),
    Column("state", String(16), nullable=False),
    Column("seed", BigInteger, nullable=False),
    Column("excitation", String(32)),
    # JSON of a goal that the user brought.
    Column("own_goal", Text),
    Column("robot_order", Text, nullable=False, default="[]"),
    Column("first_choice", String(40)),
    Column("departure", Words),
    Column("passed_over_s", Float),
    Column("fence", Integer, nullable=False, default=0),
    Column("robot", String(40)),
    Column("lease_until_s", Float),
    Column("faults", Integer, nullable=False, default=0),
    Column("outcome", Text),
    Column("log_sha256", String(64)),
    Column("log_bytes", BigInteger),
    Column("truth_sha256", String(64)),
    UniqueConstraint("job_number", "ordinal"),
    Index("ix_trial_queue", "state", "first_choice", "priority", "owner", "job_number", "ordinal"),
    # PostgreSQL finds the first of an order behind "is null" in a partial index only.
    Index(
        "ix_trial_undrawn",
        *("priority", "owner", "job_number", "ordinal"),
        sqlite_where=text(UNDRAWN),
        postgresql_where=text(UNDRAWN),
    ),
    # No robot ever has two leases.
    Index("ix_trial_lease", "robot", unique=True, sqlite_where=text(LEASED), postgresql_where=text(LEASED)),
)

turn = Table(
    "turn",
    metadata,
    Column("owner", String(64), primary_key=True),
    # When a trial of theirs was last leased; the owner who has waited longest comes next.
    Column("served_s", Float, nullable=False),
)

leader = Table(
    "leader",
    metadata,
    # What is led; one row for each role.
    Column("role", String(20), primary_key=True),
    Column("holder", String(40)),
    # By the clock of the database's host; whoever leads says again and again that it does.
    Column("until_s", Float, nullable=False),
)

attempt = Table(
    "attempt",
    metadata,
    Column("trial_id", String(30), ForeignKey("trial.trial_id"), primary_key=True),
    Column("fence", Integer, primary_key=True),
    Column("job_number", NUMBER, nullable=False, index=True),
    Column("robot", String(40), nullable=False),
    Column("state", String(16), nullable=False),
    Column("reason", Words),
    Column("departure", Words),
    Column("started_at", String(40), nullable=False),
    Column("ended_at", String(40)),
    Column("outcome", Text),
    Column("log_sha256", String(64), index=True),
    Column("truth_sha256", String(64), index=True),
    Index("ix_attempt_robot_state", "robot", "state"),
)

event = Table(
    "event",
    metadata,
    Column("job_number", NUMBER, ForeignKey("job.number"), primary_key=True),
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("at", String(40), nullable=False),
    Column("kind", String(24), nullable=False),
    Column("trial_ordinal", Integer),
    Column("robot", String(40)),
    Column("text", Words, nullable=False),
    Column("trials_done", Integer, nullable=False),
    Column("successes", Integer, nullable=False),
    Column("state", String(16), nullable=False),
)

report = Table(
    "report",
    metadata,
    Column("job_number", NUMBER, ForeignKey("job.number"), primary_key=True, autoincrement=False),
    Column("body", LargeBinary, nullable=False),
    Column("sha256", String(64), nullable=False),
    Column("created_at", String(40), nullable=False),
)

robot = Table(
    "robot",
    metadata,
    Column("robot", String(40), primary_key=True),
    Column("instance", String(100)),
    Column("pid", Integer),
    Column("host", String(200)),
    Column("physics", NUMBER, ForeignKey("physics.number")),
    Column("drain", Boolean, nullable=False, default=False),
    Column("trials_done", Integer, nullable=False, default=0),
    Column("faults_in_a_row", Integer, nullable=False, default=0),
    # When it was last given the canary's job.
    Column("canary_s", Float),
    # Why the farm has taken it out of service.
    Column("withdrawn", Words),
    # For who looks into the database; no code reads it. It stays, since older services insert it while a farm is updated.
    Column("first_seen_at", String(40), nullable=False),
)

canary = Table(
    "canary",
    metadata,
    # There is one row or none.
    Column("number", Integer, primary_key=True, autoincrement=False),
    Column("policy", String(64), ForeignKey("policy.digest"), nullable=False),
    Column("task", String(32), nullable=False),
    Column("trials", Integer, nullable=False),
    Column("at_least", Float, nullable=False),
    Column("every_s", Float, nullable=False),
    Column("seed", BigInteger, nullable=False),
    Column("set_by", String(64), nullable=False),
    Column("set_at", String(40), nullable=False),
)

token = Table(
    "token",
    metadata,
    Column("token_id", String(20), primary_key=True),
    Column("owner", String(64), nullable=False),
    Column("scopes", Text, nullable=False),
    Column("secret_sha256", String(64), nullable=False),
    Column("created_at", String(40), nullable=False),
    Column("expires_at", String(40)),
    Column("last_used_at", String(40)),
    Column("revoked_at", String(40)),
    # A token of one robot, and the token of the farm that it was derived from.
    Column("robot", String(40)),
    Column("parent", String(20)),
)

# Why a trial failed: asked once, answered once.
why = Table(
    "why",
    metadata,
    Column("trial_id", String(30), ForeignKey("trial.trial_id"), primary_key=True),
    # Of the trial's job, and the trial's robot.
    Column("owner", String(64), nullable=False),
    Column("robot", String(40), nullable=False),
    # Whether the owner asked, which uses up a question of theirs about the robot; operators ask as they like.
    Column("counted", Boolean, nullable=False),
    Column("state", String(16), nullable=False),
    Column("asked_s", Float, nullable=False),
    # When it may be taken, again if a process that had it is gone.
    Column("due_s", Float, nullable=False),
    Column("tries", Integer, nullable=False),
    # JSON with effects and values: for operators.
    Column("answer", Text),
    Column("problem", Words),
    Index("ix_why_open", "state", "due_s"),
    Index("ix_why_budget", "owner", "robot"),
)

# A report, or a trial, that may be seen by whoever has its link.
share = Table(
    "share",
    metadata,
    Column("number", NUMBER, primary_key=True, autoincrement=True),
    Column("share_id", String(20), nullable=False, unique=True),
    # Of what the link ends with, which stands nowhere.
    Column("secret_sha256", String(64), nullable=False, unique=True),
    Column("job_number", NUMBER, ForeignKey("job.number"), nullable=False),
    # The trial and its moment; null for the report.
    Column("trial_id", String(30), ForeignKey("trial.trial_id")),
    Column("at_s", Float),
    # Who made it, with which token: it ends with that.
    Column("owner", String(64), nullable=False, index=True),
    Column("token_id", String(20), nullable=False),
    Column("created_at", String(40), nullable=False),
    Column("expires_s", Float, nullable=False),
    Column("revoked_at", String(40)),
)

# Sessions of the dashboard that were signed out: the hash of the cookie, and when it is too old anyhow.
signed_out = Table(
    "signed_out",
    metadata,
    Column("mark", String(64), primary_key=True),
    Column("until_s", Float, nullable=False),
    # When it was signed out; null where a process of an older version wrote it.
    Column("at_s", Float, index=True),
)

# How often a token or an address has asked, at all processes of the services together.
asked = Table(
    "asked",
    metadata,
    Column("name", String(120), primary_key=True),
    Column("times", BigInteger, nullable=False),
    Column("at_s", Float, nullable=False),
)
