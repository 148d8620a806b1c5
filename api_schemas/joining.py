"""How a robot comes onto the bus: what it shows to the API, and what it is told and given."""

import re

from pydantic import Field

from api_schemas.schema import Schema

MAX_REQUEST = 4096
"""Characters of a signing request; one of an Ed25519 key has some 400."""
_NUMBERS = re.compile(r"(\d+)\.(\d+)(?:\..*)?")


class BusRequest(Schema):
    """Body of POST /v1/robots/{robot}/bus; the key of the signing request stays with the robot."""

    signing_request: str = Field(max_length=MAX_REQUEST, description="PKCS#10 in PEM; only its public key is used")
    version: str = Field(max_length=40, description="of the robot's trifarm")


class BusAccess(Schema):
    """Where the bus is, and, where it is guarded, a certificate whose common name is the robot's."""

    farm: str
    endpoints: tuple[str, ...] = Field(min_length=1)
    certificate: str | None = Field(default=None, description="in PEM; none where the bus is open to whoever reaches it")
    authority: str | None = Field(default=None, description="the certificate that vouches for the bus's, in PEM")
    lasts_s: float | None = Field(
        default=None, description="from now to the certificate's end; the robot asks again by half of it"
    )
    version: str


def too_far_apart(robot: str, services: str) -> str | None:
    """Why a robot and services of these versions do not work together, naming which is too old; None if they do.

    Neighbours do: the same first number, second numbers that differ by at most one. A version that is not
    made of numbers, as of a checkout without an installation, is taken to be near.
    """
    found = _NUMBERS.fullmatch(robot), _NUMBERS.fullmatch(services)
    if found[0] is None or found[1] is None:
        return None
    (major, minor), (their_major, their_minor) = ((int(each[1]), int(each[2])) for each in (found[0], found[1]))
    if major == their_major and abs(minor - their_minor) <= 1:
        return None
    if (major, minor) < (their_major, their_minor):
        return f"the robot's version {robot} is too old for services of version {services}; update the robot"
    return f"the services' version {services} is too old for a robot of version {robot}; update the services"
