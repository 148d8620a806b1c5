"""Zenoh keys and messages: presence, heartbeats, live state, lease offers and commands. Never the source of truth."""

import base64
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from pydantic import ConfigDict, Field

from api_schemas.jail_report import JailReport
from api_schemas.robot import Fence, RobotHealth, RobotState
from api_schemas.scene_form import FIRST_FORM
from api_schemas.schema import Schema

ROOT = "trifarm/v1"
MAX_SESSIONS = 50_000
"""Of one router: a robot has one, and zenoh's own limit of 1,000 would send the thousand and first robot away."""
LINK_LEASE_MS = 2000
"""After so long without a sign of life the transport is closed and liveliness tokens vanish."""
HEARTBEAT_EVERY_S = 1.0
IDLE_HEARTBEATS_APART = 2.0
"""An idle robot's come so much more seldom; whatever changes is told at once."""
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


class RobotsWord(Schema):
    """What a robot tells of itself; what services do not know yet, since it is newer than they are, they leave aside."""

    model_config = ConfigDict(extra="ignore")


class Heartbeat(RobotsWord):
    """A robot's sign of life; ``instance`` changes whenever its process starts anew. Older robots tell no ``health``.

    ``cut_off_trial_id`` and ``cut_off_fence`` name its last attempt, if the API does not answer or did not when that ended.
    """

    robot: str = Field(pattern=r"^[a-z0-9-]{1,40}$")
    instance: str
    pid: int = Field(ge=0, le=2**31 - 1)
    host: str
    state: RobotState
    trial_id: str | None = None
    fence: Fence | None = None
    cut_off_trial_id: str | None = None
    cut_off_fence: Fence | None = None
    api_away: bool = False  # which is why it is out of service
    disk_full: bool = False  # likewise; it resumes by itself, too
    leaving: bool = False  # it was asked to end, and goes when what it has in hand is done
    reason: str | None = None
    physics: str = "nominal"
    physics_digest: str = Field(
        default="", max_length=64
    )  # of the content of that physics and the farm's secret; shown to nobody
    form: str = Field(default=FIRST_FORM, max_length=40)  # of the scene
    version: str = ""
    sees: bool = False  # whether it has cameras for policies that see
    jail: JailReport | None = None  # what its policies are put into
    health: RobotHealth | None = None


class Change(Schema):
    """One process of the services has changed a job, or something else; the others look into the database."""

    job_id: str | None = None


class LiveState(RobotsWord):
    """What a robot shows while it runs, at 10 Hz of wall time.

    ``goal`` is the wanted pose of the object (x, y, z in m, quaternion wxyz) or, where fingertips have the goal, their nine
    coordinates in m; older robots tell none.
    """

    robot: str
    trial_id: str
    fence: Fence
    simulated_s: float
    duration_s: float
    joint_position_rad: tuple[float, ...] = Field(max_length=9)
    tracked_cube_position_world_m: tuple[float, ...] = Field(max_length=3)
    tracked_cube_quat_wxyz: tuple[float, ...] = Field(max_length=4)
    goal: tuple[float, ...] | None = Field(default=None, max_length=9)


class CommandKind(StrEnum):
    """What the dispatcher may tell a robot."""

    CANCEL = "cancel"  # stop the named trial
    DRAIN = "drain"  # finish the running trial, take no other
    RESUME = "resume"


class Command(Schema):
    """A command; the reply is an OfferReply and acknowledges it."""

    kind: CommandKind
    trial_id: str | None = None
    fence: Fence | None = None


@dataclass(frozen=True)
class Identity:
    """By what a session shows who it is, and whom it believes: PEM texts.

    Attributes:
        certificate: its own; on a guarded bus the common name is what access rules go by.
        key: of the certificate.
        authority: the certificate that must vouch for whoever is at the other end.
    """

    certificate: str
    key: str = field(repr=False)
    authority: str


def session_config(
    *,
    mode: str,
    connect: Sequence[str] = (),
    listen: Sequence[str] = (),
    identity: Identity | None = None,
    access_rules: dict[str, Any] | None = None,
) -> dict[str, Any]:
    """Zenoh settings of every trifarm session: explicit endpoints, no multicast, no gossip, a short link lease.

    No shared memory either: messages are small, and each link would look for some ten times a second, on both ends.

    With an identity, both ends of ``tls/`` endpoints must show certificates of its authority, the one that listens
    also one of its address; a link ends with the certificate of the other end.
    """
    link: dict[str, Any] = {"tx": {"lease": LINK_LEASE_MS}}
    if identity is not None:
        link["tls"] = _tls(identity)
    settings = {
        "mode": mode,
        "connect": {"endpoints": list(connect), "retry": CONNECT_AGAIN},
        "listen": {"endpoints": list(listen)},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"link": link, "shared_memory": {"enabled": False}, "unicast": {"max_sessions": MAX_SESSIONS}},
    }
    return settings if access_rules is None else settings | {"access_control": access_rules}


def session_config_json(
    *,
    mode: str,
    connect: Sequence[str] = (),
    listen: Sequence[str] = (),
    identity: Identity | None = None,
    access_rules: dict[str, Any] | None = None,
) -> str:
    """``session_config`` as the JSON text that ``zenoh.Config.from_json5`` reads."""
    return json.dumps(session_config(mode=mode, connect=connect, listen=listen, identity=identity, access_rules=access_rules))


def is_guarded(endpoint: str) -> bool:
    """Whether links to this endpoint are encrypted, and both ends show certificates."""
    return endpoint.startswith("tls/")


def host_of(endpoint: str) -> str:
    """The name or address in an endpoint such as ``tls/farm.example.org:7447`` or ``tcp/[::1]:7447``."""
    return endpoint.partition("/")[2].partition("#")[0].rpartition(":")[0].strip("[]")


def _tls(identity: Identity) -> dict[str, Any]:
    certificate, key = _base64(identity.certificate), _base64(identity.key)
    return {
        "root_ca_certificate_base64": _base64(identity.authority),
        "listen_certificate_base64": certificate,
        "listen_private_key_base64": key,
        "connect_certificate_base64": certificate,
        "connect_private_key_base64": key,
        "enable_mtls": True,
        "verify_name_on_connect": True,
        "close_link_on_expiration": True,
    }


def _base64(text: str) -> str:
    return base64.b64encode(text.encode()).decode()
