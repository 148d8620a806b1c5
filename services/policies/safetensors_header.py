"""The header of a safetensors file checked by its own arithmetic, and the numbers for being numbers, before any parser runs."""

import json
import math
import struct
from collections.abc import Callable
from typing import Any

import numpy as np

from services.policies.unfit import UnfitError, not_finite

HEADER_LIMIT_BYTES = 1024 * 1024
TENSOR_LIMIT = 512
DTYPE_BYTES = {"F16": 2, "F32": 4, "F64": 8}
LENGTH_BYTES = 8
EXPONENT = {2: (np.uint16, 0x7C00), 4: (np.uint32, 0x7F800000), 8: (np.uint64, 0x7FF0000000000000)}
"""The bits that are all set in a number that is not finite, by the bytes of the number."""
BRACKET_LIMIT = 8 * TENSOR_LIMIT
"""How many objects or lists JSON may hold before a parser of it sees it: what each costs is a multiple of its two bytes."""
CHUNK_BYTES = 1024 * 1024


def check_safetensors(content: memoryview | bytes, forget: Callable[[], object] = lambda: None) -> None:
    """Raises unless a header describes exactly the bytes that follow it, and these are finite numbers.

    Args:
        content: the whole file.
        forget: called now and then; may drop from memory what has been read.

    Raises:
        UnfitError: the header is too long, cannot be read, or leaves gaps or overlaps; or a number is not finite.
    """
    size = len(content)
    if size < LENGTH_BYTES:
        raise _broken(f"it has {size} bytes, less than the {LENGTH_BYTES} of a header's length")
    (length,) = struct.unpack("<Q", content[:LENGTH_BYTES])
    if length > min(HEADER_LIMIT_BYTES, size - LENGTH_BYTES):
        raise _broken(f"its header has {length} bytes; at most {HEADER_LIMIT_BYTES} and the file's size are taken")
    start = LENGTH_BYTES + length
    for begin, end, name, width in _checked(_parsed(bytes(content[LENGTH_BYTES:start])), size - start):
        _check_finite(content[start + begin : start + end], name, width, forget)


def _parsed(text: bytes) -> dict[str, Any]:
    if text[:1] != b"{" or text.count(b"{") > BRACKET_LIMIT or text.count(b"[") > BRACKET_LIMIT:
        raise _broken(f"its header is not JSON of 1 to {TENSOR_LIMIT} tensors")
    try:
        header = json.loads(text.decode(), object_pairs_hook=_without_repeats, parse_constant=_no_constant)
    except (ValueError, RecursionError) as error:
        raise _broken(f"its header is not JSON: {str(error)[:200]}") from error
    if not isinstance(header, dict):
        raise _broken("its header is not a JSON object")
    notes = header.pop("__metadata__", {})
    if not isinstance(notes, dict) or not all(isinstance(each, str) for each in notes.values()):
        raise _broken("its __metadata__ must be texts by name")
    return header


def _checked(tensors: dict[str, Any], data_bytes: int) -> list[tuple[int, int, str, int]]:
    if not 1 <= len(tensors) <= TENSOR_LIMIT:
        raise _broken(f"it has {len(tensors)} tensors; 1 to {TENSOR_LIMIT} are taken")
    spans = sorted(_span(name, tensor) for name, tensor in tensors.items())
    at = 0
    for begin, end, name, _ in spans:
        if begin != at:
            raise _broken(f"it begins at byte {begin} where {at} was expected: gaps and overlaps are refused", name)
        at = end
    if at != data_bytes:
        raise _broken(f"its tensors take {at} bytes, but {data_bytes} follow the header")
    return spans


def _span(name: str, tensor: Any) -> tuple[int, int, str, int]:
    if not isinstance(tensor, dict) or set(tensor) != {"dtype", "shape", "data_offsets"}:
        raise _broken("it must have dtype, shape and data_offsets", name)
    width = DTYPE_BYTES.get(tensor["dtype"]) if isinstance(tensor["dtype"], str) else None
    if width is None:
        raise _broken(f"it has dtype {tensor['dtype']!r:.100}; choose from {', '.join(DTYPE_BYTES)}", name)
    shape, offsets = tensor["shape"], tensor["data_offsets"]
    if not _counts(shape) or not _counts(offsets) or len(offsets) != 2:
        raise _broken("it has a shape or offsets that are not whole numbers", name)
    if offsets[1] - offsets[0] != math.prod(shape) * width:
        raise _broken(f"its shape {shape} does not fit its {offsets[1] - offsets[0]} bytes", name)
    return offsets[0], offsets[1], name, width


def _check_finite(data: memoryview | bytes, name: str, width: int, forget: Callable[[], object]) -> None:
    kind, mask = EXPONENT[width]
    bits = np.frombuffer(data, kind)
    for at in range(0, len(bits), CHUNK_BYTES // width):
        forget()
        if (bits[at : at + CHUNK_BYTES // width] & kind(mask)).max() == mask:
            raise not_finite(_part(name))


def _counts(values: Any) -> bool:
    return isinstance(values, list) and len(values) <= 8 and all(type(value) is int and 0 <= value < 2**48 for value in values)


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len({name for name, _ in pairs}) != len(pairs):
        raise ValueError("a name appears twice")
    return dict(pairs)


def _no_constant(text: str) -> None:
    raise ValueError(f"{text} is no JSON")


def _part(name: str) -> str:
    return f"tensor {name!r:.100}"


def _broken(reason: str, name: str | None = None) -> UnfitError:
    return UnfitError(
        f"not a well-formed safetensors file: {reason}",
        part="the header" if name is None else _part(name),
        slug="weights-malformed",
        instead="write it again with safetensors.save_file, and check that the upload was not cut short",
    )
