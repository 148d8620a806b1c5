"""Routes of tokens, for administrators."""

from typing import Annotated

from fastapi import APIRouter, Depends, Path

from api_schemas.token import NewToken, TokenPage, TokenRequest
from services.api.access import Admin
from services.api.farm import TheFarm
from services.api.paging import encode, named
from services.database.pages import Asked

router = APIRouter(prefix="/v1/tokens", tags=["tokens"])
TokenId = Annotated[str, Path(pattern=r"^[A-Za-z0-9.@-]{1,20}$")]


@router.post("", status_code=201)
async def make_token(body: TokenRequest, _caller: Admin, farm: TheFarm) -> NewToken:
    """Makes a token; its secret is shown this once."""
    return await farm.tokens.make(body)


@router.get("")
async def list_tokens(_caller: Admin, farm: TheFarm, asked: Annotated[Asked, Depends(named(usual=1000, most=1000))]) -> TokenPage:
    """Tokens without their secrets, by id."""
    page = await farm.tokens.page(asked)
    return TokenPage(tokens=tuple(page.entries), next_cursor=encode(page.following))


@router.delete("/{token_id}", status_code=204)
async def revoke_token(token_id: TokenId, _caller: Admin, farm: TheFarm) -> None:
    """Ends a token at once."""
    await farm.tokens.revoke(token_id)
