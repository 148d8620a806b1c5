"""A robot's way onto the bus: what the API says of it, and the key and certificate by which a guarded one knows the robot."""

import time
from dataclasses import dataclass, field
from importlib.metadata import version
from urllib.parse import urlsplit

from cryptography import x509
from cryptography.hazmat.primitives import serialization
from cryptography.hazmat.primitives.asymmetric.ed25519 import Ed25519PrivateKey
from cryptography.x509.oid import NameOID

from api_schemas import bus
from api_schemas.joining import BusAccess, BusRequest, too_far_apart
from robot_farm.link.api_link import ApiLink, LeaseRefusedError, NotAdmittedError, understood
from robot_farm.settings import Settings

ANYWHERE = frozenset({"0.0.0.0", "::"})  # noqa: S104  compared with, not listened on
RENEW_AFTER = 0.5
"""Of a certificate's life: the rest is for an API that is away."""


@dataclass(frozen=True)
class Access:
    """What a robot opens the bus with.

    Attributes:
        endpoints: where the bus is; tried in turn.
        farm: its name on the bus.
        identity: what a guarded bus is shown.
        renew_at_s: when to ask for the next certificate, on ``clock_s``; None if there is none.
    """

    endpoints: tuple[str, ...]
    farm: str
    identity: bus.Identity | None = field(default=None, repr=False)
    renew_at_s: float | None = None

    def is_due(self, now_s: float) -> bool:
        """Whether another certificate should be asked for."""
        return self.renew_at_s is not None and now_s >= self.renew_at_s

    def session_config(self) -> str:
        """What ``zenoh.open`` is told."""
        return bus.session_config_json(mode="client", connect=self.endpoints, identity=self.identity)


def clock_s() -> float:
    """Seconds of a clock that goes on while the machine sleeps, as certificates do."""
    return time.clock_gettime(time.CLOCK_BOOTTIME)


def ask_access(api: ApiLink, robot: str, settings: Settings) -> Access:
    """Asks the API how to come onto the bus, with a new key; what the robot was told itself wins.

    A robot that was told an open bus and the farm's name does not ask.

    Raises:
        ApiUnreachableError: no answer.
        NotAdmittedError: the token was revoked, the robot is not expected, or the versions do not fit.
    """
    if settings.bus is not None and settings.farm is not None and not bus.is_guarded(settings.bus):
        return Access((settings.bus,), settings.farm)
    key, asked_s = Ed25519PrivateKey.generate(), clock_s()
    told = _told(api, robot, BusRequest(signing_request=_request(key, robot), version=version("trifarm")))
    endpoints = (settings.bus,) if settings.bus else tuple(_seen_from(settings.api, each) for each in told.endpoints)
    farm = settings.farm or told.farm
    if told.certificate is None or told.authority is None or told.lasts_s is None:
        return Access(endpoints, farm)
    identity = bus.Identity(told.certificate, _private(key), told.authority)
    return Access(endpoints, farm, identity, asked_s + RENEW_AFTER * told.lasts_s)


def _told(api: ApiLink, robot: str, request: BusRequest) -> BusAccess:
    path = f"/v1/robots/{robot}/bus"
    try:
        answer = api.once("POST", path, json=request.model_dump(mode="json"))
    except LeaseRefusedError as error:  # 404: services from before there was this route; 409: too far apart
        raise NotAdmittedError(f"the farm does not let this robot onto its bus: {error}") from error
    told = understood(BusAccess, answer, f"POST {path}")
    if (apart := too_far_apart(request.version, told.version)) is not None:
        raise NotAdmittedError(apart)
    return told


def _seen_from(api: str, endpoint: str) -> str:
    """An endpoint of a bus that listens on all addresses of its host, which is then the API's."""
    host = bus.host_of(endpoint)
    if host not in ANYWHERE:
        return endpoint
    reached = urlsplit(api).hostname or host
    protocol, port = endpoint.partition("/")[0], endpoint.rpartition(":")[2]
    return f"{protocol}/{f'[{reached}]' if ':' in reached else reached}:{port}"


def _request(key: Ed25519PrivateKey, robot: str) -> str:
    subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, robot)])
    signed = x509.CertificateSigningRequestBuilder().subject_name(subject).sign(key, None)
    return signed.public_bytes(serialization.Encoding.PEM).decode()


def _private(key: Ed25519PrivateKey) -> str:
    plain = serialization.NoEncryption()
    return key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, plain).decode()
