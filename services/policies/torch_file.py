"""A state_dict as torch.save writes it, read without torch and without unpickling: a machine of a few opcodes that calls nothing.

The pickle within names three kinds of things: OrderedDict, a tensor's rebuilding and the storages' types. Here they are mere
marks; whatever else a pickle names is refused before it is looked up.
"""

import math
import pickletools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from services.policies.unfit import UnfitError
from services.policies.zip_directory import Entry, inflate, read_directory

ENTRY_LIMIT = 2048
PICKLE_LIMIT_BYTES = 1024 * 1024
OPCODE_LIMIT = 100_000
DIMENSION_LIMIT = 4
STORAGES = {
    "torch HalfStorage": "<f2",
    "torch FloatStorage": "<f4",
    "torch DoubleStorage": "<f8",
    "torch LongStorage": "<i8",
    "torch IntStorage": "<i4",
    "torch BoolStorage": "?",
}
DICTIONARY, REBUILD = "collections OrderedDict", "torch._utils _rebuild_tensor_v2"


@dataclass(frozen=True)
class Storage:
    """An entry of the archive and the type of its numbers."""

    key: str
    kind: str
    count: int


Description = tuple[Storage, int, tuple[int, ...], tuple[int, ...]]
"""Of a tensor: its storage, the place of its first number there, its shape and its strides."""


@dataclass(frozen=True)
class Named:
    """Something that a pickle names; it is never looked up."""

    name: str


def check_archive(content: memoryview, limit_bytes: int) -> dict[str, Entry]:
    """The entries of a torch file by their name without the folder; nothing is inflated.

    Raises:
        UnfitError: it is not a zip archive of a pickle and numbers.
    """
    entries = read_directory(content, entry_limit=ENTRY_LIMIT, plain_limit_bytes=limit_bytes)
    folders = {name.partition("/")[0] for name in entries}
    found = {name.partition("/")[2]: entry for name, entry in entries.items()}
    if len(folders) != 1 or "data.pkl" not in found:
        raise UnfitError("it is not a torch file: it has no data.pkl in one folder", slug="archive-malformed")
    for name, entry in found.items():
        known = name in ("data.pkl", "version", "byteorder") or name.startswith((".", "data/"))
        if not known:
            raise UnfitError("a state_dict has no such entry", part=f"entry {entry.name}", slug="torchscript", pack=True)
    if found["data.pkl"].plain_bytes > PICKLE_LIMIT_BYTES:
        raise UnfitError(
            f"its list of tensors has {found['data.pkl'].plain_bytes} bytes; at most {PICKLE_LIMIT_BYTES} are taken",
            part="entry data.pkl",
            slug="archive-too-large",
        )
    return found


def read_tensors(content: memoryview, limit_bytes: int, wanted: Callable[[str], bool]) -> dict[str, np.ndarray]:
    """The tensors of a state_dict that are wanted by their name.

    Raises:
        UnfitError: the pickle does more than to list tensors, they do not fit the numbers that are there, or have more than
            ``limit_bytes`` together.
    """
    entries = check_archive(content, limit_bytes)
    order = bytes(inflate(content, entries["byteorder"])) if "byteorder" in entries else b"little"
    if order != b"little":
        raise _broken(f"its numbers are in the order {order[:20]!r}; only little is taken", "entry byteorder")
    listed = run(bytes(inflate(content, entries["data.pkl"])))
    if not isinstance(listed, dict) or not all(isinstance(name, str) for name in listed):
        raise _broken("it is not a dictionary of tensors by name", "entry data.pkl")
    described = {name: _description(entries, value, _part(name)) for name, value in listed.items() if wanted(name)}
    # Many names may stand for one storage: small as it lies there, large once each has its own numbers.
    size = sum(np.dtype(storage.kind).itemsize * math.prod(shape) for storage, _, shape, _ in described.values())
    if size > limit_bytes:
        raise UnfitError(
            f"its tensors have {size} bytes together; at most {limit_bytes} are taken",
            part="entry data.pkl",
            slug="archive-too-large",
        )
    return {name: _tensor(content, entries, each) for name, each in described.items()}


def _part(name: str) -> str:
    return f"tensor {name!r:.100}"


def _tensor(content: memoryview, entries: Mapping[str, Entry], described: Description) -> np.ndarray:
    storage, offset, shape, strides = described
    numbers = np.frombuffer(inflate(content, entries[f"data/{storage.key}"]), storage.kind)
    steps = [stride * numbers.itemsize for stride in strides]
    return np.array(np.lib.stride_tricks.as_strided(numbers[offset:], shape, steps, writeable=False))


def _description(entries: Mapping[str, Entry], value: Any, part: str) -> Description:
    if not isinstance(value, tuple) or len(value) < 4 or not isinstance(value[0], Storage):
        raise _broken("it is not a tensor", part)
    storage, offset, shape, strides = value[:4]
    lists = isinstance(shape, tuple) and isinstance(strides, tuple) and len(shape) == len(strides) <= DIMENSION_LIMIT
    if not lists or not all(type(each) is int and 0 <= each < 2**40 for each in (offset, *shape, *strides)):
        raise _broken("its shape cannot be read", part)
    entry = entries.get(f"data/{storage.key}")
    if entry is None or entry.plain_bytes != storage.count * np.dtype(storage.kind).itemsize:
        raise _broken("the bytes of its numbers are not there", part)
    last = offset + sum((size - 1) * stride for size, stride in zip(shape, strides, strict=True))
    if 0 in shape or last >= storage.count:
        raise _broken(f"its shape {shape} reaches beyond its {storage.count} numbers", part)
    # A stride of 0 lets few numbers stand for many.
    if math.prod(shape) > storage.count:
        raise _broken("it has more numbers than it stores", part)
    return storage, offset, shape, strides


def run(pickled: bytes) -> Any:
    """What a pickle of tensors builds, with a tuple (storage, offset, shape, strides, …) for each tensor.

    Raises:
        UnfitError: it is cut short, or has an opcode or a name that no state_dict needs.
    """
    machine = Machine()
    try:
        for number, (opcode, argument, _) in enumerate(pickletools.genops(pickled)):
            if number >= OPCODE_LIMIT:
                raise _broken(f"it has more than {OPCODE_LIMIT} opcodes", "entry data.pkl")
            if opcode.name == "STOP":
                return machine.stack[-1]
            machine.step(opcode.name, argument)
    except UnfitError:
        raise
    except Exception as error:  # whatever a malformed pickle makes of a small stack
        raise _broken(f"its pickle is malformed ({type(error).__name__})", "entry data.pkl") from error
    raise _broken("its pickle has no end", "entry data.pkl")


class Machine:
    """The stack and the memo of a pickle; builds dictionaries, tuples and numbers, and calls nothing."""

    def __init__(self) -> None:
        self.stack: list[Any] = []
        self._memo: dict[int, Any] = {}
        self._marks: list[int] = []

    def step(self, name: str, argument: Any) -> None:
        """Carries out one opcode.

        Raises:
            UnfitError: it is none of those that list tensors.
        """
        if name == "MARK":
            self._marks.append(len(self.stack))
        elif name in _PUSHED:
            self.stack.append(_PUSHED[name]())
        elif name in ("BININT", "BININT1", "BININT2", "LONG1", "BINUNICODE", "SHORT_BINUNICODE"):
            self.stack.append(argument)
        elif name in ("BINPUT", "LONG_BINPUT"):
            self._memo[argument] = self.stack[-1]
        elif name in ("BINGET", "LONG_BINGET"):
            self.stack.append(self._memo[argument])
        elif name == "GLOBAL":
            self.stack.append(_allowed(argument))
        elif name == "BINPERSID":
            self.stack[-1] = _storage(self.stack[-1])
        elif name.startswith("TUPLE"):
            items = self._popped() if name == "TUPLE" else [self.stack.pop() for _ in range(int(name[-1]))][::-1]
            self.stack.append(tuple(items))
        elif name == "REDUCE":
            arguments = self.stack.pop()
            self.stack[-1] = _reduced(self.stack[-1], arguments)
        elif name in ("SETITEM", "SETITEMS"):
            items = self._popped() if name == "SETITEMS" else [self.stack.pop(-2), self.stack.pop()]
            _set_items(self.stack[-1], items)
        elif name == "BUILD":
            self.stack.pop()  # the metadata of a state_dict: the versions of its modules
        elif name != "PROTO":
            raise _broken(f"its pickle has the opcode {name}, which a list of tensors does not need", "entry data.pkl")

    def _popped(self) -> list[Any]:
        at = self._marks.pop()
        items = self.stack[at:]
        del self.stack[at:]
        return items


_PUSHED: dict[str, Callable[[], Any]] = {
    "EMPTY_DICT": dict,
    "EMPTY_TUPLE": tuple,
    "NEWTRUE": lambda: True,
    "NEWFALSE": lambda: False,
    "NONE": lambda: None,
}


def _set_items(target: Any, items: list[Any]) -> None:
    if not isinstance(target, dict) or len(items) % 2 or not all(isinstance(key, str) for key in items[::2]):
        raise _broken("it sets items that are not named by texts, or of what is no dictionary", "entry data.pkl")
    target.update(zip(items[::2], items[1::2], strict=True))


def _allowed(name: str) -> Named:
    if name in (DICTIONARY, REBUILD) or name in STORAGES:
        return Named(name)
    raise UnfitError(
        f"its pickle names {name!r:.100}, and only tensors and dictionaries are taken; nothing of it was run",
        part="entry data.pkl",
        slug="pickle",
        pack=True,
    )


def _storage(given: Any) -> Storage:
    mark, kind, key, _, count = given
    if mark != "storage" or not isinstance(kind, Named) or kind.name not in STORAGES or not str(key).isdecimal():
        raise _broken("it refers to something that is no storage", "entry data.pkl")
    return Storage(str(key), STORAGES[kind.name], int(count))


def _reduced(called: Any, arguments: Any) -> Any:
    if called == Named(DICTIONARY) and arguments == ():
        return {}
    if called == Named(REBUILD) and isinstance(arguments, tuple):
        return arguments
    raise _broken("it calls something", "entry data.pkl")


def _broken(reason: str, part: str) -> UnfitError:
    return UnfitError(f"not a list of tensors: {reason}", part=part, slug="archive-malformed", pack=True)
