"""Texts that a user or robot gave, as they may be shown: what cannot be seen, or turns text around, stands as an escape."""

import unicodedata

UNSEEN = frozenset({"Cc", "Cf", "Cs", "Co", "Zl", "Zp"})
"""Categories of Unicode: control, format (bidirectional, zero-width), surrogates, private use, separators of lines."""
KEPT = frozenset("\n\t")


def visible(text: str) -> str:
    r"""The text with ``\u202e`` and its like as escapes; lines and tabs stay."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(_escaped(each) if unicodedata.category(each) in UNSEEN and each not in KEPT else each for each in text)


def _escaped(character: str) -> str:
    code = ord(character)
    return f"\\u{code:04x}" if code < 1 << 16 else f"\\U{code:08x}"
