import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.api.paging import decode_name, decode_number, encode, named, numbered
from services.database.pages import Asked
from services.errors import Refused

NAMES = st.text(st.characters(min_codepoint=33, max_codepoint=126), min_size=1, max_size=40)
NUMBERED, NAMED = numbered(usual=50, most=200), named(usual=50, most=200)


@given(st.integers(0, 2**53))
def test_a_cursor_of_a_number_comes_back(number):
    assert decode_number(encode(number)) == number


@given(NAMES)
def test_a_cursor_of_a_name_comes_back(name):
    assert decode_name(encode(name)) == name


async def test_the_last_page_has_none():
    assert encode(None) is None
    assert [await asked(None, 7) for asked in (NUMBERED, NAMED)] == [Asked(7)] * 2


@pytest.mark.parametrize("cursor", ["", "x", "n1", "é", "bjE_", "bi0x", "bg", "\x00", "=" * 7])
@pytest.mark.parametrize("asked", [NUMBERED, NAMED])
async def test_others_are_refused(cursor, asked):
    with pytest.raises(Refused, match="next_cursor"):
        await asked(cursor, 50)


async def test_a_cursor_of_another_kind_of_list_is_refused():
    for asked, key in ((NUMBERED, "robot-1"), (NAMED, 1)):
        with pytest.raises(Refused, match="next_cursor"):
            await asked(encode(key), 50)


@given(st.text(max_size=40))
def test_any_text_is_a_key_or_a_refusal(cursor):
    with contextlib.suppress(Refused):
        assert decode_number(cursor) >= 0
    with contextlib.suppress(Refused):
        assert decode_name(cursor)


def test_a_number_that_no_row_has_is_refused():
    assert decode_number(encode(1000), largest=1000) == 1000
    with pytest.raises(Refused, match="next_cursor"):
        decode_number(encode(1001), largest=1000)
    with pytest.raises(Refused, match="next_cursor"):
        decode_number(encode(10**18))
