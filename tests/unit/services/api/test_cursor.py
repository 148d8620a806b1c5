import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from services.api.cursor import decode, encode
from services.errors import Refused


@given(st.none() | st.integers(0, 2**53))
def test_a_cursor_comes_back(number):
    assert decode(encode(number)) == number


@pytest.mark.parametrize("cursor", ["", "x", "n1", "é", "bjE_", "bi0x", "bg", "\x00", "=" * 7])
def test_others_are_refused(cursor):
    with pytest.raises(Refused, match="next_cursor"):
        decode(cursor)


@given(st.text(max_size=40))
def test_any_text_is_a_number_or_a_refusal(cursor):
    with contextlib.suppress(Refused):
        assert decode(cursor) >= 0


def test_a_number_that_no_row_has_is_refused():
    assert decode(encode(1000), most=1000) == 1000
    with pytest.raises(Refused, match="next_cursor"):
        decode(encode(1001), most=1000)
    with pytest.raises(Refused, match="next_cursor"):
        decode(encode(10**18))
