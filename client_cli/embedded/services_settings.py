"""Which variables of the caller's environment the services of an embedded farm are given, and which it decides by itself."""

from collections.abc import Mapping

from client_cli.embedded.child_process import OWN_PREFIX

PASSED_ON = frozenset(
    {
        "TRIFARM_ANONYMOUS_REQUESTS_PER_S",
        "TRIFARM_AUDIT_FILE",
        "TRIFARM_BODY_STALL_S",
        "TRIFARM_CONVERSION_AT_ONCE",
        "TRIFARM_CONVERSION_DEADLINE_S",
        "TRIFARM_DISK_RESERVE_BYTES",
        "TRIFARM_FARM_KEY",
        "TRIFARM_FOXGLOVE_URL",
        "TRIFARM_HEAD_WITHIN_S",
        "TRIFARM_HOSTS",
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
        "TRIFARM_OFFER_TIMEOUT_S",
        "TRIFARM_PASS_OVER_S",
        "TRIFARM_PINNED_ROBOT_GONE_S",
        "TRIFARM_PUBLIC_LEADERBOARD",
        "TRIFARM_REFUSED_PAUSE_S",
        "TRIFARM_RENEW_EVERY_S",
        "TRIFARM_REQUESTS_PER_S",
        "TRIFARM_RERUN_URL",
        "TRIFARM_ROBOT_REQUESTS_PER_S",
        "TRIFARM_SHARES",
        "TRIFARM_STUDIES",
        "TRIFARM_SWEEP_EVERY_S",
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
"""Settings of the services that an operator may choose for an embedded farm."""
DECIDED = frozenset(
    {
        "TRIFARM_ADMIN_TOKEN",
        "TRIFARM_ALIVE_FILE",
        "TRIFARM_BUS",
        "TRIFARM_BUS_ADDRESSES",
        "TRIFARM_BUS_CERTIFICATE_S",
        "TRIFARM_BUS_CONNECT",
        "TRIFARM_BUS_KEY",
        "TRIFARM_BUS_ROBOTS",
        "TRIFARM_BUS_ROUTERS",
        "TRIFARM_DATA",
        "TRIFARM_DATABASE_URL",
        "TRIFARM_DISPATCHES",
        "TRIFARM_FARM",
        "TRIFARM_FILES_URL",
        "TRIFARM_HOST",
        "TRIFARM_JAIL_LEVEL",
        "TRIFARM_METRICS_PORT",
        "TRIFARM_PHYSICS",
        "TRIFARM_PORT",
        "TRIFARM_ROBOT_TOKEN",
        "TRIFARM_S3_ACCESS_KEY_ID",
        "TRIFARM_S3_ENDPOINT",
        "TRIFARM_S3_REGION",
        "TRIFARM_S3_SECRET_ACCESS_KEY",
        "TRIFARM_TLS_CERTIFICATE",
        "TRIFARM_TLS_KEY",
    }
)
"""Settings of the services that an embedded farm has by its flags and by what it is: http and the bus on 127.0.0.1 alone, truth
and files in its data folder.
"""
OF_THE_COMMAND_LINE = frozenset({"TRIFARM_URL", "TRIFARM_TOKEN", "TRIFARM_CA", "TRIFARM_HOME"})


def given_settings(environ: Mapping[str, str]) -> dict[str, str]:
    """What the services of an embedded farm are told of the caller's environment; the robots are told nothing of it.

    A test compares the names with the services' own, which this program does not import.
    """
    return {name: value for name, value in environ.items() if name in PASSED_ON}


def ignored_settings(environ: Mapping[str, str]) -> list[str]:
    """The ``TRIFARM_*`` variables of the caller that an embedded farm has no use for, in order."""
    known = PASSED_ON | OF_THE_COMMAND_LINE
    return sorted(name for name in environ if name.startswith(OWN_PREFIX) and name not in known)
