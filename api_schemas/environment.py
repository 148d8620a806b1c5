"""The ``TRIFARM_*`` variables that programs of the project read, and what is said of any other: nobody heeds it."""

from collections.abc import Mapping
from difflib import get_close_matches

PREFIX = "TRIFARM_"
OF_SERVICES = frozenset(
    {
        "TRIFARM_ADMIN_TOKEN",
        "TRIFARM_ALIVE_FILE",
        "TRIFARM_ANONYMOUS_REQUESTS_PER_S",
        "TRIFARM_AUDIT_FILE",
        "TRIFARM_BODY_STALL_S",
        "TRIFARM_BUS",
        "TRIFARM_BUS_ADDRESSES",
        "TRIFARM_BUS_CERTIFICATE_S",
        "TRIFARM_BUS_CONNECT",
        "TRIFARM_BUS_KEY",
        "TRIFARM_BUS_ROBOTS",
        "TRIFARM_BUS_ROUTERS",
        "TRIFARM_CONVERSION_AT_ONCE",
        "TRIFARM_CONVERSION_DEADLINE_S",
        "TRIFARM_DATA",
        "TRIFARM_DATABASE_URL",
        "TRIFARM_DISK_RESERVE_BYTES",
        "TRIFARM_DISPATCHES",
        "TRIFARM_FARM",
        "TRIFARM_FARM_KEY",
        "TRIFARM_FILES_URL",
        "TRIFARM_FOXGLOVE_URL",
        "TRIFARM_HEAD_WITHIN_S",
        "TRIFARM_HOST",
        "TRIFARM_HOSTS",
        "TRIFARM_JAIL_LEVEL",
        "TRIFARM_KEEP_LOGS_BYTES",
        "TRIFARM_KEEP_LOGS_DAYS",
        "TRIFARM_LEASE_S",
        "TRIFARM_LICHTBLICK_URL",
        "TRIFARM_MAX_ATTEMPTS",
        "TRIFARM_MAX_LOG_BYTES",
        "TRIFARM_MAX_POLICY_BYTES_PER_USER",
        "TRIFARM_MAX_QUEUED_JOBS_PER_USER",
        "TRIFARM_MAX_QUEUED_TRIALS_PER_USER",
        "TRIFARM_MAX_TRIALS_PER_JOB",
        "TRIFARM_MAX_WEIGHTS_BYTES",
        "TRIFARM_METRICS_PORT",
        "TRIFARM_OFFER_TIMEOUT_S",
        "TRIFARM_PASS_OVER_S",
        "TRIFARM_PHYSICS",
        "TRIFARM_PINNED_ROBOT_GONE_S",
        "TRIFARM_PORT",
        "TRIFARM_PUBLIC_LEADERBOARD",
        "TRIFARM_REFUSED_PAUSE_S",
        "TRIFARM_RENEW_EVERY_S",
        "TRIFARM_REQUESTS_PER_S",
        "TRIFARM_RERUN_URL",
        "TRIFARM_ROBOT_REQUESTS_PER_S",
        "TRIFARM_ROBOT_TOKEN",
        "TRIFARM_S3_ACCESS_KEY_ID",
        "TRIFARM_S3_ENDPOINT",
        "TRIFARM_S3_REGION",
        "TRIFARM_S3_SECRET_ACCESS_KEY",
        "TRIFARM_SHARES",
        "TRIFARM_STUDIES",
        "TRIFARM_SWEEP_EVERY_S",
        "TRIFARM_TLS_CERTIFICATE",
        "TRIFARM_TLS_KEY",
        "TRIFARM_TRIALS_PAGE",
        "TRIFARM_TRUSTED_PROXIES",
        "TRIFARM_USER_TRIALS_AT_ONCE",
        "TRIFARM_VERIFICATION_AT_ONCE",
        "TRIFARM_VERIFICATION_DEADLINE_S",
        "TRIFARM_VERIFICATION_UPLOAD_S",
        "TRIFARM_WEBHOOKS",
        "TRIFARM_WHYS_PER_ROBOT",
        "TRIFARM_WHY_DEADLINE_S",
    }
)
"""Those of ``services/settings.py``, which a test compares."""
OF_ROBOTS = frozenset(
    {
        "TRIFARM_ALIVE_FILE",
        "TRIFARM_CA",
        "TRIFARM_FARM_SEED",
        "TRIFARM_JAIL_LEVEL",
        "TRIFARM_ROBOT_RESERVE_BYTES",
        "TRIFARM_ROBOT_TOKEN",
    }
)
OF_THE_COMMAND_LINE = frozenset({"TRIFARM_URL", "TRIFARM_TOKEN", "TRIFARM_CA", "TRIFARM_HOME"})
ELSEWHERE = frozenset({"TRIFARM_FULL_DISK_HERE", "TRIFARM_KEY", "TRIFARM_MCAP_DOCTOR", "TRIFARM_PICTURES", "TRIFARM_RERUN"})
"""Of ``docker-compose.yml`` and of checks in a clone."""
OF_CHAOS = f"{PREFIX}CHAOS_"
KNOWN = OF_SERVICES | OF_ROBOTS | OF_THE_COMMAND_LINE | ELSEWHERE


def unknown_settings(environ: Mapping[str, str]) -> dict[str, str]:
    """The ``TRIFARM_*`` variables that no program of the project reads, each with a sentence about it, in order.

    They are told at the start and refused nowhere. An older version gets the environment of a newer one where a farm is updated
    bit by bit or goes back, and Kubernetes gives each container variables named after its services (``TRIFARM_PORT_8787_TCP``).
    """
    unknown = sorted(name for name in environ if name.startswith(PREFIX) and name not in KNOWN and not name.startswith(OF_CHAOS))
    return {name: f"no program of trifarm reads {name}{_meant(name)}" for name in unknown}


def _meant(name: str) -> str:
    near = get_close_matches(name, sorted(KNOWN), n=1, cutoff=0.8)
    return f"; did you mean {near[0]}?" if near else ""
