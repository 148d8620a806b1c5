"""What nobody sees stands as an escape; what everybody sees stays."""

import pytest

from api_schemas.visible import visible


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("push-3 (best)", "push-3 (best)"),
        ("Grünes Tuch, 触覚, \U0001f916", "Grünes Tuch, 触覚, \U0001f916"),
        ("two\nlines\tand a tab", "two\nlines\tand a tab"),
        ("abc\u202egnp.exe", "abc\\u202egnp.exe"),
        ("ad\u200bmin\ufeff", "ad\\u200bmin\\ufeff"),
        ("\x1b[31mred\x07\r", "\\u001b[31mred\\u0007\\u000d"),
        ("\u2066x\u2069\u2028y\ud800", "\\u2066x\\u2069\\u2028y\\ud800"),
        ("\U000e0041", "\\U000e0041"),
    ],
)
def test_what_is_not_seen_is_an_escape(text, shown):
    assert visible(text) == shown
