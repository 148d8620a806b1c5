"""The zenoh session of a process of the services: a router here, or a client of one elsewhere; guarded or open."""

from api_schemas import bus
from services.errors import NotReady
from services.joining.authority import Authority
from services.joining.rules import access_rules
from services.settings import Settings
from services.signing import KEY_FILE, FarmKey

ANYWHERE = frozenset({"", "0.0.0.0", "::"})  # noqa: S104  compared with, not listened on


def session_config(settings: Settings, key: FarmKey | None) -> str:
    """What ``zenoh.open`` is told.

    Args:
        settings: of the process; ``bus_connect`` makes it a client.
        key: the farm's, from which certificates are made; without it those of ``settings`` are looked for where they are needed.

    Raises:
        NotReady: a guarded bus lacks the farm's key, or an address under which it is reached.
    """
    endpoint = settings.bus_connect or settings.bus
    if not bus.is_guarded(endpoint):
        return _plain(settings)
    authority = Authority.of(key or _shared_key(settings))
    if settings.bus_connect is not None:
        return bus.session_config_json(mode="client", connect=[endpoint], identity=authority.of_services())
    identity = authority.of_services(_reached_as(settings))
    rules = access_rules(settings.farm, settings.guarded_robots)
    return bus.session_config_json(mode="router", listen=[endpoint], identity=identity, access_rules=rules)


def _plain(settings: Settings) -> str:
    if settings.bus_connect is not None:
        return bus.session_config_json(mode="client", connect=[settings.bus_connect])
    return bus.session_config_json(mode="router", listen=[settings.bus])


def _shared_key(settings: Settings) -> FarmKey:
    """The key that the other processes have; a router that made one of its own would be believed by nobody."""
    if settings.farm_key is None and not (settings.data / KEY_FILE).exists():
        what = f"{settings.bus_connect or settings.bus} is guarded by certificates that are made of the farm's key"
        raise NotReady(f"{what}; set TRIFARM_FARM_KEY to that of the farm's other services processes")
    return FarmKey.of(settings.data, None if settings.farm_key is None else settings.farm_key.get_secret_value())


def _reached_as(settings: Settings) -> set[str]:
    """The hosts that the router's certificate is for."""
    hosts = {bus.host_of(each) for each in (settings.bus, *settings.bus_endpoints)} - ANYWHERE
    if not hosts:
        what = f"the bus listens on {settings.bus}, and its certificate must name the host by which robots reach it"
        raise NotReady(f"{what}; set TRIFARM_BUS_ADDRESSES, such as tls/farm.example.org:7447")
    return hosts
