"""The route by which a robot comes onto the bus; with it an address and a token are all that a robot needs."""

from datetime import UTC, datetime

from fastapi import APIRouter

from api_schemas.bus import is_guarded
from api_schemas.joining import BusAccess, BusRequest, too_far_apart
from services.api.access import RobotCaller
from services.api.document import refusals
from services.api.farm import Farm, TheFarm
from services.api.robots import Name
from services.errors import Conflict, Forbidden
from services.joining.authority import Authority

router = APIRouter(prefix="/v1/robots", tags=["robots"])


@router.post("/{robot}/bus", responses=refusals(409))
async def join_bus(robot: Name, body: BusRequest, caller: RobotCaller, farm: TheFarm) -> BusAccess:
    """Where the bus is and, where it is guarded, a new certificate for the robot, which ends soon and is asked for again."""
    if caller.robot not in (None, robot):
        detail = f"The token is of {caller.robot}, not of {robot}; it can come onto the bus as itself only."
        raise Forbidden("token-of-another-robot", detail)
    if (apart := too_far_apart(body.version, farm.version)) is not None:
        raise Conflict("versions-apart", f"They do not work together: {apart}.")
    settings = farm.settings
    told = BusAccess(farm=settings.farm, endpoints=settings.bus_endpoints, version=farm.version)
    if not is_guarded(settings.bus_endpoints[0]):
        return told
    return told.model_copy(update=_certified(farm, robot, body))


def _certified(farm: Farm, robot: str, body: BusRequest) -> dict[str, object]:
    expected, lasts_s = farm.settings.guarded_robots, farm.settings.bus_certificate_s
    if robot not in expected:
        which = f"the rules of the bus name {expected[0]} to {expected[-1]}"
        raise Forbidden("robot-not-expected", f"{robot} cannot come onto the bus: {which}; TRIFARM_BUS_ROBOTS sets how many.")
    authority, now = Authority.of(farm.key), datetime.fromtimestamp(farm.clock.now_s(), UTC)
    made = authority.of_robot(robot, body.signing_request, now, lasts_s)
    return {"certificate": made, "authority": authority.certificate, "lasts_s": lasts_s}
