"""An ONNX file walked field by field in its wire form, within limits and without building anything, before a parser sees it.

A field that is not in the tables below is refused, whatever its meaning may be to a newer runtime than ours.
"""

from collections.abc import Callable
from dataclasses import dataclass

from services.policies.operators import ALLOWED
from services.policies.unfit import UnfitError

VARINT, FIXED64, BYTES, FIXED32 = 0, 1, 2, 5
FIELD_LIMIT = 60_000
FORGET_EVERY = 4096
NODE_LIMIT = 5_000
DEPTH_LIMIT = 16
"""Messages within messages: a graph within a node of a graph takes three."""
NESTED_GRAPH_LIMIT = 64
NAME_LIMIT_BYTES = 1024
TEXT_LIMIT_BYTES = 4 * 1024 * 1024
"""All that is not numbers, together."""
DIMENSION_LIMIT = 8
NUMBER_LIMIT_BYTES = 8 * 1024 * 1024
"""Whole numbers in their packed form, together: each byte of them may become eight. Weights are not kept so."""
DOMAINS = frozenset({b"", b"ai.onnx"})
NUMBERS = frozenset(range(1, 8)) | {9, 10, 11, 12, 13}
"""The types of tensors from float to uint64, without complex numbers; text, 8, is refused by its own sentence."""

MESSAGES: dict[str, dict[int, str]] = {
    "Model": {
        1: "varint", 2: "text", 3: "text", 4: "text", 5: "varint", 6: "text", 7: "Graph", 8: "OpsetId", 14: "Pair",
    },
    "OpsetId": {1: "domain", 2: "varint"},
    "Pair": {1: "text", 2: "text"},
    "Graph": {
        1: "Node", 2: "text", 5: "Tensor", 10: "text", 11: "ValueInfo", 12: "ValueInfo", 13: "ValueInfo", 14: "Annotation",
        16: "Pair",
    },
    "Annotation": {1: "text", 2: "Pair"},
    "Node": {
        1: "name", 2: "name", 3: "text", 4: "operator", 5: "Attribute", 6: "text", 7: "domain", 8: "empty", 9: "Pair",
    },
    "Attribute": {
        1: "name", 2: "fixed32", 3: "varint", 4: "text", 5: "Tensor", 6: "Graph", 7: "numbers32", 8: "numbers", 9: "text",
        10: "Tensor", 11: "Graph", 13: "text", 20: "varint",
    },
    "Tensor": {
        1: "dims", 2: "type", 4: "numbers32", 5: "numbers", 7: "numbers", 8: "name", 9: "raw", 10: "numbers64", 11: "numbers",
        12: "text", 14: "location", 16: "Pair",
    },
    "ValueInfo": {1: "name", 2: "Type", 3: "text", 4: "Pair"},
    "Type": {1: "TensorType", 6: "text"},
    "TensorType": {1: "varint", 2: "Shape"},
    "Shape": {1: "Dimension"},
    "Dimension": {1: "varint", 2: "name", 3: "text"},
}  # fmt: skip
"""What is taken: by message and number of a field, another message or how its value is written."""

WIRE = {
    "varint": (VARINT,), "type": (VARINT,), "location": (VARINT,), "dims": (VARINT, BYTES), "numbers": (VARINT, BYTES),
    "fixed32": (FIXED32,), "numbers32": (FIXED32, BYTES), "numbers64": (FIXED64, BYTES),
}  # fmt: skip
"""The wire types of values that are not plain bytes."""

REFUSED: dict[tuple[str, int], tuple[str, str, str]] = {
    ("Tensor", 13): ("a tensor keeps its numbers in another file", "external-data", "`trifarm pack FILE` makes one file of both"),
    ("Model", 20): ("the file has instructions for training", "onnx-part", "export for inference"),
    ("Model", 25): ("the file brings its own functions", "onnx-operator", "export with functions inlined"),
    ("Graph", 15): ("sparse tensors are not taken", "onnx-part", "store them dense"),
    ("Attribute", 22): ("sparse tensors are not taken", "onnx-part", "store them dense"),
    ("Attribute", 23): ("sparse tensors are not taken", "onnx-part", "store them dense"),
    ("Tensor", 6): ("a tensor of texts is not taken", "onnx-part", "a policy computes with numbers alone"),
}
"""What users may meet, with the sentence for it."""


@dataclass
class Walk:
    """What has been counted so far."""

    fields: int = 0
    nodes: int = 0
    graphs: int = 0
    text_bytes: int = 0
    dims: int = 0
    number_bytes: int = 0
    unknown: tuple[bytes, int] | None = None
    """An operator that is not taken and how deep its node lies, until the node's end: its domain may say more."""


def check_onnx(content: memoryview, forget: Callable[[], object] = lambda: None) -> None:
    """Raises unless a file is made of nothing but nodes of allowed operators, dense numbers within the file, and names.

    Args:
        content: the whole file.
        forget: called now and then; may drop from memory what has been read.

    Raises:
        UnfitError: names the part and the limit.
    """
    walk = Walk()
    # (message, next byte, first byte behind it); a list instead of calls, so that depth is counted and not suffered.
    open_messages: list[tuple[str, int, int]] = [("Model", 0, len(content))]
    while open_messages:
        message, at, end = open_messages.pop()
        while at < end:
            walk.fields += 1
            if walk.fields > FIELD_LIMIT:
                raise _over(f"it has more than {FIELD_LIMIT} fields")
            if walk.fields % FORGET_EVERY == 0:
                forget()
            key, at = _varint(content, at, end)
            number, wire = key >> 3, key & 7
            kind = MESSAGES[message].get(number)
            if kind is None:
                raise _unknown(message, number)
            if wire not in WIRE.get(kind, (BYTES,)):
                raise _broken(f"field {number} of {message} is written as type {wire}")
            value, begin, at = _value(content, at, end, wire)
            if kind in MESSAGES:
                _enter(walk, kind, len(open_messages))
                open_messages.append((message, at, end))
                message, at, end = kind, begin, at
            else:
                _check(walk, kind, value, content[begin:at], len(open_messages))
        if walk.unknown and walk.unknown[1] == len(open_messages):
            raise _not_taken(walk.unknown[0])
    if walk.graphs == 0:
        raise _broken("it holds no graph")


def _enter(walk: Walk, kind: str, depth: int) -> None:
    if depth >= DEPTH_LIMIT:
        raise _over(f"its graphs lie more than {DEPTH_LIMIT // 3} deep within each other")
    if kind == "Graph":
        walk.graphs += 1
        if depth == 0 and walk.graphs > 1:
            raise _broken("it holds two graphs")
        if walk.graphs > NESTED_GRAPH_LIMIT:
            raise _over(f"it has more than {NESTED_GRAPH_LIMIT} nested graphs")
    elif kind == "Node":
        walk.nodes += 1
        if walk.nodes > NODE_LIMIT:
            raise _over(f"the graph has more than {NODE_LIMIT} nodes")
    elif kind == "Tensor":
        walk.dims = 0


def _check(walk: Walk, kind: str, value: int, data: memoryview, depth: int) -> None:
    if kind in ("text", "name", "operator", "domain", "empty"):
        walk.text_bytes += len(data)
        if walk.text_bytes > TEXT_LIMIT_BYTES:
            raise _over(f"names and notes take more than {TEXT_LIMIT_BYTES} bytes")
        if kind != "text":
            _check_name(kind, bytes(data[: NAME_LIMIT_BYTES + 1]))
        if kind == "operator" and bytes(data).decode("latin-1") not in ALLOWED:
            walk.unknown = bytes(data), depth
    elif kind == "location" and value:
        raise _refusal("Tensor", 13)
    elif kind == "type" and value not in NUMBERS:
        raise (
            _refusal("Tensor", 6)
            if value == 8
            else UnfitError(
                f"a tensor has the type {value}; floats, integers and booleans are taken", part="a tensor", slug="onnx-part"
            )
        )
    elif kind == "numbers":
        walk.number_bytes += len(data)
        if walk.number_bytes > NUMBER_LIMIT_BYTES:
            raise _over(f"its packed whole numbers take more than {NUMBER_LIMIT_BYTES} bytes")
    elif kind == "dims":
        walk.dims += 1
        if walk.dims > DIMENSION_LIMIT or len(data) > 10 * DIMENSION_LIMIT:
            raise _broken(f"a tensor has more than {DIMENSION_LIMIT} dimensions")


def _check_name(kind: str, name: bytes) -> None:
    if len(name) > NAME_LIMIT_BYTES:
        raise _over(f"a name has more than {NAME_LIMIT_BYTES} bytes")
    if (kind == "domain" and name not in DOMAINS) or (kind == "empty" and name):
        raise UnfitError(
            "only operators of ONNX's default domain are taken, none of a library's own",
            part=f"domain {_shown(name)}",
            slug="onnx-operator",
            instead="export without custom operators",
        )


def _not_taken(name: bytes) -> UnfitError:
    return UnfitError(
        "the operator is not among those that are taken",
        part=f"operator {_shown(name)}",
        slug="onnx-operator",
        instead="export the deterministic mean action as plain arithmetic; docs/policies.md lists the operators",
    )


def _value(content: memoryview, at: int, end: int, wire: int) -> tuple[int, int, int]:
    """A number if it is one, where its bytes begin, and where the next field begins."""
    if wire == VARINT:
        value, after = _varint(content, at, end)
        return value, at, after
    length, begin = (8, at) if wire == FIXED64 else (4, at) if wire == FIXED32 else _varint(content, at, end)
    if length > end - begin:
        raise _broken("a field is longer than what it lies in, as if the file were cut short")
    return 0, begin, begin + length


def _varint(content: memoryview, at: int, end: int) -> tuple[int, int]:
    value = shift = 0
    while at < end and shift < 70:
        byte = content[at]
        at += 1
        value |= (byte & 127) << shift
        if byte < 128:
            return value, at
        shift += 7
    raise _broken("a number in it has no end, as if the file were cut short")


def _unknown(message: str, number: int) -> UnfitError:
    if (message, number) in REFUSED:
        return _refusal(message, number)
    if message == "Type":
        return UnfitError("only tensors are taken, no sequences, maps or optional values", slug="onnx-part")
    return _broken(f"{message} has the field {number}, which a policy does not need")


def _refusal(message: str, number: int) -> UnfitError:
    why, slug, instead = REFUSED[message, number]
    return UnfitError(why, part=message.lower(), slug=slug, instead=instead)


def _shown(name: bytes) -> str:
    return repr(name[:60].decode("ascii", "replace"))


def _over(reason: str) -> UnfitError:
    return UnfitError(reason, slug="onnx-too-large", instead="export the policy's network alone, for one observation")


def _broken(reason: str) -> UnfitError:
    return UnfitError(
        f"not an ONNX file that can be read: {reason}",
        slug="weights-malformed",
        instead="export it again as one file, and check that the upload was not cut short",
    )
