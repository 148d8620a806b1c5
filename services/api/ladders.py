"""Routes of ladders: several checkpoints on the same goals."""

from typing import Annotated

from fastapi import APIRouter, Path, Query, Response

from api_schemas.ladder import Ladder, LadderPage, LadderRequest
from services.api import cursor as cursors
from services.api.access import Submitter, User
from services.api.document import refusals
from services.api.farm import Farm, TheFarm
from services.api.jobs import IdempotencyKey, check_priority, sender_of
from services.api.tokens import Caller
from services.jobs import ladders

router = APIRouter(prefix="/v1/ladders", tags=["ladders"])
LadderId = Annotated[str, Path(pattern=r"^[a-z0-9]{1,20}$")]


@router.post("", response_model=Ladder, status_code=201, responses={200: {"model": Ladder}, **refusals(404, 409)})
async def create_ladder(
    body: LadderRequest, response: Response, caller: Submitter, farm: TheFarm, idempotency_key: IdempotencyKey = None
) -> Ladder:
    """Queues a job for each checkpoint, all on the same goals; with an Idempotency-Key the same request twice is one ladder."""
    check_priority(caller, body.priority)
    async with farm.database.write() as tx:
        sender = sender_of(caller, farm, idempotency_key)
        ladder_id, new = await ladders.submit(tx, farm.clock.now_s(), body, sender)
    farm.signals.wake_dispatcher()
    farm.signals.tell_others(None)
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/v1/ladders/{ladder_id}"
    return await seen_ladder(ladder_id, caller, farm)


@router.get("")
async def list_ladders(
    caller: User, farm: TheFarm, cursor: str | None = None, limit: Annotated[int, Query(ge=1, le=200)] = 50
) -> LadderPage:
    """Ladders, newest first; users see their own, operators all."""
    async with farm.database.read() as connection:
        found = await ladders.lines(connection, caller.sees_only, cursors.decode(cursor), limit + 1)
    following = found[limit - 1][0] if len(found) > limit else None
    return LadderPage(ladders=tuple(line for _, line in found[:limit]), next_cursor=cursors.encode(following))


@router.get("/{ladder_id}")
async def get_ladder(ladder_id: LadderId, caller: User, farm: TheFarm) -> Ladder:
    """One ladder: the success of each checkpoint with its interval, as far as its trials are done."""
    return await seen_ladder(ladder_id, caller, farm)


async def seen_ladder(ladder_id: str, caller: Caller, farm: Farm) -> Ladder:
    """A ladder that the caller may see."""
    async with farm.database.read() as connection:
        return await ladders.show(connection, ladder_id, caller.sees_only)
