"""What each identity may do on a guarded bus: a robot speaks on its own keys and is asked on them, services do everything."""

from collections.abc import Iterable
from typing import Any

from api_schemas import bus
from services.joining.authority import SERVICES

EVERYTHING = (
    "put",
    "delete",
    "query",
    "reply",
    "declare_subscriber",
    "declare_queryable",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)
BOTH_WAYS = ("ingress", "egress")
ALL, HEARD = "services do everything", "robots know that they are heard"


def access_rules(farm: str, robots: Iterable[str]) -> dict[str, Any]:
    """Zenoh's ``access_control`` for a router: whoever is not named here may do nothing.

    Rules go by the common name of certificates. They are fixed once the router is open, and a rule has no place for the
    name of whoever it is applied to, so that each robot has rules of its own.
    """
    told_where = [bus.heartbeat_key(farm, "*"), bus.live_key(farm, "*")]
    rules = [
        _rule(ALL, EVERYTHING, BOTH_WAYS, ["**"]),
        # A publisher sends only what somebody has subscribed to, and services subscribe to all robots at once.
        _rule(HEARD, ("declare_subscriber",), ("egress",), told_where),
    ]
    subjects, policies = [_subject(SERVICES)], [_policy([ALL], SERVICES)]
    for robot in robots:
        own = _of_robot(farm, robot)
        rules += own
        subjects.append(_subject(robot))
        policies.append(_policy([HEARD, *(rule["id"] for rule in own)], robot))
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


def _of_robot(farm: str, robot: str) -> list[dict[str, Any]]:
    asked = [bus.offer_key(farm, robot), bus.command_key(farm, robot)]
    said = [bus.heartbeat_key(farm, robot), bus.live_key(farm, robot)]
    return [
        _rule(f"{robot} is there", ("liveliness_token",), ("ingress",), [bus.alive_key(farm, robot)]),
        _rule(f"{robot} speaks", ("put",), ("ingress",), said),
        _rule(f"{robot} is asked", ("query",), ("egress",), asked),
        _rule(f"{robot} answers", ("declare_queryable", "reply"), ("ingress",), asked),
    ]


def _rule(name: str, messages: Iterable[str], flows: Iterable[str], keys: list[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "messages": list(messages), "flows": list(flows), "key_exprs": keys}


def _subject(name: str) -> dict[str, Any]:
    return {"id": name, "cert_common_names": [name]}


def _policy(rules: list[str], subject: str) -> dict[str, Any]:
    return {"rules": rules, "subjects": [subject]}
