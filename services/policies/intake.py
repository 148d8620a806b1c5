"""What is checked of weights before anything parses them: size, and for safetensors the header's own arithmetic."""

import json
import math
import struct
from pathlib import Path
from typing import Any

from api_schemas.policy import WeightsFormat
from services.errors import Refused, TooLarge

HEADER_LIMIT_BYTES = 1024 * 1024
TENSOR_LIMIT = 512
DTYPE_BYTES = {"F16": 2, "F32": 4, "F64": 8}
LENGTH_BYTES = 8


def weights_format(filename: str | None) -> WeightsFormat:
    """The form of the weights, by the end of their file's name.

    Raises:
        Refused: neither .safetensors nor .onnx.
    """
    for known in WeightsFormat:
        if (filename or "").lower().endswith(f".{known}"):
            return known
    raise Refused(
        "unknown-weights-format",
        f"The weights' file is named {filename!r}; its name must end in .safetensors or .onnx. "
        "Pickles, .pt and .zip files can carry code and are not taken.",
    )


def check_weights(path: Path, kind: WeightsFormat, limit_bytes: int) -> None:
    """Raises unless the file may be given to a parser.

    Raises:
        TooLarge: over the limit.
        Refused: empty, or not a well-formed safetensors file.
    """
    size = path.stat().st_size
    if size > limit_bytes:
        raise TooLarge("weights-too-large", f"The weights have {size} bytes; at most {limit_bytes} are taken.")
    if size == 0:
        raise Refused("weights-empty", "The weights' file is empty.")
    if kind == WeightsFormat.SAFETENSORS:
        with path.open("rb") as file:
            header = file.read(LENGTH_BYTES + HEADER_LIMIT_BYTES)
        check_safetensors(header, size)


def check_safetensors(start: bytes, size: int) -> None:
    """Raises unless a safetensors header describes exactly the bytes that follow it.

    Args:
        start: the first bytes of the file, with the whole header in them.
        size: bytes of the whole file.

    Raises:
        Refused: the header is too long, cannot be read, or leaves gaps or overlaps.
    """
    if len(start) < LENGTH_BYTES:
        raise _broken(f"it has {size} bytes, less than the {LENGTH_BYTES} of a header's length")
    (length,) = struct.unpack("<Q", start[:LENGTH_BYTES])
    if length > min(HEADER_LIMIT_BYTES, size - LENGTH_BYTES):
        raise _broken(f"its header has {length} bytes; at most {HEADER_LIMIT_BYTES} and the file's size are taken")
    try:
        header = json.loads(start[LENGTH_BYTES : LENGTH_BYTES + length], object_pairs_hook=_without_repeats)
    except (ValueError, RecursionError) as error:
        raise _broken(f"its header is not JSON: {error}") from error
    if not isinstance(header, dict):
        raise _broken("its header is not a JSON object")
    header.pop("__metadata__", None)
    _check_tensors(header, size - LENGTH_BYTES - length)


def _check_tensors(tensors: dict[str, Any], data_bytes: int) -> None:
    if not 1 <= len(tensors) <= TENSOR_LIMIT:
        raise _broken(f"it has {len(tensors)} tensors; 1 to {TENSOR_LIMIT} are taken")
    spans = sorted(_span(name, tensor) for name, tensor in tensors.items())
    at = 0
    for begin, end, name in spans:
        if begin != at:
            raise _broken(f"tensor {name!r} begins at byte {begin} where {at} was expected: gaps and overlaps are refused")
        at = end
    if at != data_bytes:
        raise _broken(f"its tensors take {at} bytes, but {data_bytes} follow the header")


def _span(name: str, tensor: Any) -> tuple[int, int, str]:
    if not isinstance(tensor, dict) or set(tensor) != {"dtype", "shape", "data_offsets"}:
        raise _broken(f"tensor {name!r} must have dtype, shape and data_offsets")
    width = DTYPE_BYTES.get(tensor["dtype"]) if isinstance(tensor["dtype"], str) else None
    if width is None:
        raise _broken(f"tensor {name!r} has dtype {tensor['dtype']!r}; choose from {', '.join(DTYPE_BYTES)}")
    shape, offsets = tensor["shape"], tensor["data_offsets"]
    if not _counts(shape) or not _counts(offsets) or len(offsets) != 2:
        raise _broken(f"tensor {name!r} has a shape or offsets that are not whole numbers")
    if offsets[1] - offsets[0] != math.prod(shape) * width:
        raise _broken(f"tensor {name!r} of shape {shape} does not fit its {offsets[1] - offsets[0]} bytes")
    return offsets[0], offsets[1], name


def _counts(values: Any) -> bool:
    return isinstance(values, list) and len(values) <= 8 and all(type(value) is int and 0 <= value < 2**48 for value in values)


def _without_repeats(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    if len({name for name, _ in pairs}) != len(pairs):
        raise ValueError("a name appears twice")
    return dict(pairs)


def _broken(reason: str) -> Refused:
    return Refused("weights-malformed", f"The safetensors file is not well formed: {reason}.")
