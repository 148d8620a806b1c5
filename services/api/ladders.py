"""Routes of ladders: several checkpoints on the same goals."""

from typing import Annotated

from fastapi import APIRouter, Depends, Path, Response

from api_schemas.ladder import Ladder, LadderPage, LadderRequest
from services.api.access import Submitter, User
from services.api.document import refusals
from services.api.farm import Farm, TheFarm
from services.api.jobs import IdempotencyKey, check_priority, sender_of
from services.api.paging import encode, numbered
from services.database.pages import Asked
from services.jobs import ladders
from services.tokens import Caller

router = APIRouter(prefix="/v1/ladders", tags=["ladders"])
LadderId = Annotated[str, Path(pattern=r"^[a-z0-9]{1,20}$")]


@router.post("", response_model=Ladder, status_code=201, responses={200: {"model": Ladder}, **refusals(404, 409)})
async def create_ladder(
    body: LadderRequest, response: Response, caller: Submitter, farm: TheFarm, idempotency_key: IdempotencyKey = None
) -> Ladder:
    """Queues a job for each checkpoint, all on the same goals; with an Idempotency-Key the same request twice is one ladder."""
    check_priority(caller, body.priority)
    farm.disk.check()
    async with farm.database.write() as tx:
        sender = sender_of(caller, farm, idempotency_key)
        ladder_id, new = await ladders.submit(tx, farm.clock.now_s(), body, sender)
    farm.signals.wake_dispatcher()
    farm.signals.tell_others(None)
    response.status_code = 201 if new else 200
    response.headers["Location"] = f"/v1/ladders/{ladder_id}"
    return await seen_ladder(ladder_id, caller, farm)


@router.get("")
async def list_ladders(caller: User, farm: TheFarm, asked: Annotated[Asked, Depends(numbered(usual=50, most=200))]) -> LadderPage:
    """Ladders, newest first; users see their own, operators all."""
    async with farm.database.read() as connection:
        page = await ladders.lines(connection, caller.sees_only, asked)
    return LadderPage(ladders=tuple(page.entries), next_cursor=encode(page.following))


@router.get("/{ladder_id}")
async def get_ladder(ladder_id: LadderId, caller: User, farm: TheFarm) -> Ladder:
    """One ladder: the success of each checkpoint with its interval, as far as its trials are done."""
    return await seen_ladder(ladder_id, caller, farm)


async def seen_ladder(ladder_id: str, caller: Caller, farm: Farm) -> Ladder:
    """A ladder that the caller may see."""
    async with farm.database.read() as connection:
        return await ladders.show(connection, ladder_id, caller.sees_only)
