"""Which variables of the caller's environment the services of an embedded farm are given, and which it decides by itself."""

from collections.abc import Mapping

from api_schemas.environment import KNOWN, OF_SERVICES, OF_THE_COMMAND_LINE

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
PASSED_ON = OF_SERVICES - DECIDED
"""Settings of the services that an operator may choose for an embedded farm."""


def given_settings(environ: Mapping[str, str]) -> dict[str, str]:
    """What the services of an embedded farm are told of the caller's environment; the robots are told nothing of it."""
    return {name: value for name, value in environ.items() if name in PASSED_ON}


def ignored_settings(environ: Mapping[str, str]) -> list[str]:
    """The variables of the caller that are known elsewhere and that an embedded farm has no use for, in order."""
    return sorted(name for name in environ if name in KNOWN - PASSED_ON - OF_THE_COMMAND_LINE)
