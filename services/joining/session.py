"""The zenoh session of a process of the services: a router here, or a client of one elsewhere; guarded or open."""

from collections.abc import Sequence

from api_schemas import bus
from services.errors import NotReady
from services.joining.authority import USE, Authority
from services.joining.rules import access_rules
from services.settings import Settings
from services.signing import KEY_FILE, FarmKey, key_bytes

ANYWHERE = frozenset({"", "0.0.0.0", "::"})  # noqa: S104  compared with, not listened on


def session_config(settings: Settings, key: FarmKey | None) -> str:
    """What ``zenoh.open`` is told.

    Args:
        settings: of the process; ``bus_connect`` makes it a client.
        key: the farm's, from which certificates are made; without it the keys of ``settings`` are used where one is needed.

    Raises:
        NotReady: a guarded bus lacks the farm's key, or an address under which it is reached.
    """
    if not bus.is_guarded((*settings.elsewhere, settings.bus)[0]):
        return _plain(settings)
    authority = Authority.of(key) if key is not None else _authority(settings)
    if settings.elsewhere:
        return bus.session_config_json(mode="client", connect=settings.elsewhere, identity=authority.of_services())
    identity = authority.of_services(_reached_as(settings))
    rules = access_rules(settings.farm, settings.guarded_robots)
    ends: dict[str, Sequence[str]] = {"listen": [settings.bus], "connect": settings.other_routers}
    return bus.session_config_json(mode="router", **ends, identity=identity, access_rules=rules)


def bus_key(settings: Settings) -> str:
    """What a guarded router needs of the farm's key, as hexadecimal digits; who has it signs no reports and no links.

    Raises:
        NotReady: the farm's key is not there.
    """
    return _shared_key(settings).secret_for(USE).hex()


def _plain(settings: Settings) -> str:
    if settings.elsewhere:
        return bus.session_config_json(mode="client", connect=settings.elsewhere)
    return bus.session_config_json(mode="router", listen=[settings.bus], connect=settings.other_routers)


def _authority(settings: Settings) -> Authority:
    if settings.bus_key is None:
        return Authority.of(_shared_key(settings))
    secret = key_bytes(settings.bus_key.get_secret_value())
    if secret is None:
        raise NotReady("TRIFARM_BUS_KEY is not 64 hexadecimal digits; set it to what 'python -m services bus-key' prints")
    return Authority.of_secret(secret)


def _shared_key(settings: Settings) -> FarmKey:
    """The key that the other processes have; a router that made one of its own would be believed by nobody."""
    if settings.farm_key is None and not (settings.data / KEY_FILE).exists():
        what = f"the certificates of a guarded bus are made of the farm's key, and {settings.data} has none"
        raise NotReady(
            f"{what}; set TRIFARM_FARM_KEY to that of the farm's other services processes or, for a router, TRIFARM_BUS_KEY"
        )
    return FarmKey.of(settings.data, None if settings.farm_key is None else settings.farm_key.get_secret_value())


def _reached_as(settings: Settings) -> set[str]:
    """The hosts that the router's certificate is for."""
    hosts = {bus.host_of(each) for each in (settings.bus, *settings.bus_endpoints)} - ANYWHERE
    if not hosts:
        what = f"the bus listens on {settings.bus}, and its certificate must name the host by which robots reach it"
        raise NotReady(f"{what}; set TRIFARM_BUS_ADDRESSES, such as tls/farm.example.org:7447")
    return hosts
