"""Routes of the canary: what idle robots try from time to time; for operators."""

from fastapi import APIRouter

from api_schemas.canary import Canary, CanaryRequest
from services.api.access import Operator
from services.api.document import refusals
from services.api.farm import Farm, TheFarm
from services.jobs import canary

router = APIRouter(prefix="/v1/canary", tags=["robots"])


@router.get("", responses=refusals(404))
async def get_canary(caller: Operator, farm: TheFarm) -> Canary:  # noqa: ARG001  it says who may ask
    """The farm's canary."""
    return await _show(farm)


@router.put("", responses=refusals(404))
async def put_canary(body: CanaryRequest, caller: Operator, farm: TheFarm) -> Canary:
    """Makes a policy the farm's canary: each robot tries it while idle, and one that does too badly goes out of service."""
    async with farm.database.write() as tx:
        await canary.choose(tx, farm.clock.now_s(), body, caller.owner)
    farm.signals.wake_dispatcher()
    farm.signals.tell_others(None)
    return await _show(farm)


@router.delete("", status_code=204)
async def delete_canary(caller: Operator, farm: TheFarm) -> None:  # noqa: ARG001  it says who may ask
    """The farm has no canary any more; robots that left its band stay out until they are resumed."""
    async with farm.database.write() as tx:
        await canary.withdraw(tx)


async def _show(farm: Farm) -> Canary:
    async with farm.database.read() as connection:
        return await canary.chosen(connection)
