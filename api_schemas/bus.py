"""Zenoh keys and messages: presence, heartbeats, live state, lease offers and commands. Never the source of truth."""

import json
from enum import StrEnum
from typing import Any

from pydantic import Field

from api_schemas.jail.report import JailReport
from api_schemas.robot import RobotState
from api_schemas.schema import Schema

ROOT = "trifarm/v1"
LINK_LEASE_MS = 2000
"""After so long without a sign of life the transport is closed and liveliness tokens vanish."""
HEARTBEAT_EVERY_S = 1.0
CONNECT_AGAIN = {"period_init_ms": 200, "period_max_ms": 500, "period_increase_factor": 1.5}
"""How often a session whose router went looks for it; without, after 1, 3 and 7 s, so that a farm waits for its robots."""


def alive_key(farm: str, robot: str) -> str:
    """Key of a robot's liveliness token; ``robot`` may be ``*``."""
    return f"{ROOT}/{farm}/robot/{robot}/alive"


def heartbeat_key(farm: str, robot: str) -> str:
    """Key on which a robot publishes its heartbeat."""
    return f"{ROOT}/{farm}/robot/{robot}/heartbeat"


def live_key(farm: str, robot: str) -> str:
    """Key on which a robot publishes its live state at 10 Hz."""
    return f"{ROOT}/{farm}/robot/{robot}/live"


def offer_key(farm: str, robot: str) -> str:
    """Key a robot answers offered leases on."""
    return f"{ROOT}/{farm}/robot/{robot}/offer"


def command_key(farm: str, robot: str) -> str:
    """Key a robot answers commands on."""
    return f"{ROOT}/{farm}/robot/{robot}/command"


def change_key(farm: str) -> str:
    """Key on which processes of the services tell each other that they changed something."""
    return f"{ROOT}/{farm}/services/change"


def robot_of_key(key: str) -> str:
    """The robot named in a key of this module."""
    return key.split("/")[4]


class Heartbeat(Schema):
    """A robot's sign of life; ``instance`` changes whenever its process starts anew."""

    robot: str = Field(pattern=r"^[a-z0-9-]{1,40}$")
    instance: str
    pid: int
    host: str
    state: RobotState
    trial_id: str | None = None
    fence: int | None = None
    reason: str | None = None
    physics: str = "nominal"
    version: str = ""
    jail: JailReport | None = None  # what its policies are put into


class Change(Schema):
    """One process of the services has changed a job, or something else; the others look into the database."""

    job_id: str | None = None


class LiveState(Schema):
    """What a robot shows while it runs, at 10 Hz of wall time."""

    robot: str
    trial_id: str
    fence: int
    simulated_s: float
    duration_s: float
    joint_position_rad: tuple[float, ...]
    tracked_cube_position_world_m: tuple[float, ...]
    tracked_cube_quat_wxyz: tuple[float, ...]


class CommandKind(StrEnum):
    """What the dispatcher may tell a robot."""

    CANCEL = "cancel"  # stop the named trial
    DRAIN = "drain"  # finish the running trial, take no other
    RESUME = "resume"


class Command(Schema):
    """A command; the reply is an OfferReply and acknowledges it."""

    kind: CommandKind
    trial_id: str | None = None
    fence: int | None = None


def session_config(*, mode: str, connect: list[str] | None = None, listen: list[str] | None = None) -> dict[str, Any]:
    """Zenoh settings of every trifarm session: explicit endpoints, no multicast, no gossip, a short link lease."""
    return {
        "mode": mode,
        "connect": {"endpoints": connect or [], "retry": CONNECT_AGAIN},
        "listen": {"endpoints": listen or []},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"link": {"tx": {"lease": LINK_LEASE_MS}}},
    }


def session_config_json(*, mode: str, connect: list[str] | None = None, listen: list[str] | None = None) -> str:
    """``session_config`` as the JSON text that ``zenoh.Config.from_json5`` reads."""
    return json.dumps(session_config(mode=mode, connect=connect, listen=listen))
