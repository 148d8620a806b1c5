import asyncio

import pytest
from fastapi import Request

from api_schemas.token import Scope
from api_schemas.trial import Verification
from services.api.truth import _receive, shown_to
from services.errors import TooLarge, TooSlow
from services.tokens import Caller

DIFFERENT = Verification(
    trial_id="j-000",
    steps=9,
    same=False,
    first_difference_step=3,
    largest_joint_difference_rad=0.5,
    largest_cube_difference_m=0.25,
)


@pytest.mark.parametrize(("scope", "told"), [(Scope.SUBMIT, False), (Scope.OPERATE, True), (Scope.ADMIN, True)])
def test_only_operators_are_told_how_large_a_difference_is(scope, told):
    shown = shown_to(Caller("t", "ann", frozenset({scope})), DIFFERENT)
    assert (shown.same, shown.first_difference_step) == (False, 3)
    assert (shown.largest_joint_difference_rad, shown.largest_cube_difference_m) == ((0.5, 0.25) if told else (None, None))


def sent(*chunks):
    """A request whose body comes in these chunks and then stops coming."""
    left = [{"type": "http.request", "body": chunk, "more_body": True} for chunk in chunks]

    async def receive():
        return left.pop(0) if left else await asyncio.Event().wait()

    return Request({"type": "http", "method": "POST", "headers": []}, receive)


async def test_a_body_that_does_not_come_is_not_waited_for(tmp_path):
    with pytest.raises(TooSlow, match=r"within 1 s; 2 bytes"):
        await _receive(tmp_path / "log.mcap", sent(b"a", b"b"), 1000, 1.0)


async def test_a_body_larger_than_such_a_log_can_be_is_refused(tmp_path):
    with pytest.raises(TooLarge, match="larger than the 10 bytes"):
        await _receive(tmp_path / "log.mcap", sent(b"abcdef", b"ghijkl"), 10, 30.0)
