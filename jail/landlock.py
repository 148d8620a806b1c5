"""Landlock: the kernel lets this process, and all that it starts, open no file but the named ones. No privilege is needed.

Numbers and structures are those of the kernel's include/uapi/linux/landlock.h; what a kernel has is told by its ABI version.
"""

import ctypes
import os
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from jail import kernel
from jail.level import Layer

_CREATE_RULESET, _ADD_RULE, _RESTRICT_SELF = 444, 445, 446
_CREATE_RULESET_VERSION = 1
_RULE_PATH_BENEATH = 1

_EXECUTE, _WRITE_FILE, _READ_FILE, _READ_DIR = 1, 1 << 1, 1 << 2, 1 << 3
_REMOVE_DIR, _REMOVE_FILE, _MAKE_DIR, _MAKE_REG = 1 << 4, 1 << 5, 1 << 7, 1 << 8
_REFER, _TRUNCATE, _IOCTL_DEV = 1 << 13, 1 << 14, 1 << 15
_FIRST_ACCESSES = (1 << 13) - 1
_ACCESSES_BY_ABI = ((2, _REFER), (3, _TRUNCATE), (5, _IOCTL_DEV))
_READ = _READ_FILE | _READ_DIR | _EXECUTE
_WRITE = _READ | _WRITE_FILE | _REMOVE_DIR | _REMOVE_FILE | _MAKE_DIR | _MAKE_REG | _TRUNCATE
_OF_ONE_FILE = _READ_FILE | _WRITE_FILE | _EXECUTE | _TRUNCATE

_NETWORK_ABI = 4
_BIND_AND_CONNECT_TCP = 3
_SCOPES_ABI = 6
_ABSTRACT_SOCKETS_AND_SIGNALS = 3


class _Ruleset(ctypes.Structure):
    """struct landlock_ruleset_attr; a kernel that knows fewer fields takes it as long as they are 0."""

    _fields_ = (("handled_access_fs", ctypes.c_uint64), ("handled_access_net", ctypes.c_uint64), ("scoped", ctypes.c_uint64))


class _PathBeneath(ctypes.Structure):
    """struct landlock_path_beneath_attr."""

    _pack_ = 1
    _fields_ = (("allowed_access", ctypes.c_uint64), ("parent_fd", ctypes.c_int32))


def abi() -> int:
    """The version of the kernel's Landlock; 0 where it has none or it is switched off."""
    try:
        return kernel.system_call(_CREATE_RULESET, 0, 0, _CREATE_RULESET_VERSION)
    except OSError:
        return 0


def restrict(readable: Iterable[Path], writable: Iterable[Path]) -> set[Layer]:
    """Closes every file and folder but these; gives the layers that this kernel's Landlock stands for.

    Needs no-new-privileges. A path that does not exist is left out.

    Raises:
        OSError: the kernel has no Landlock.
    """
    version = abi()
    handled = _FIRST_ACCESSES | sum(access for since, access in _ACCESSES_BY_ABI if version >= since)
    network = _BIND_AND_CONNECT_TCP if version >= _NETWORK_ABI else 0
    scopes = _ABSTRACT_SOCKETS_AND_SIGNALS if version >= _SCOPES_ABI else 0
    attributes = _Ruleset(handled, network, scopes)
    ruleset = kernel.system_call(_CREATE_RULESET, _address(attributes), ctypes.sizeof(attributes), 0)
    try:
        for paths, access in ((readable, _READ), (writable, _WRITE)):
            for path in paths:
                with suppress(FileNotFoundError, NotADirectoryError):
                    _allow(ruleset, path, access & handled)
        kernel.system_call(_RESTRICT_SELF, ruleset, 0)
    finally:
        os.close(ruleset)
    layers = {Layer.LANDLOCK_FILES}
    return layers | ({Layer.LANDLOCK_NETWORK} if network else set()) | ({Layer.LANDLOCK_SCOPES} if scopes else set())


def _allow(ruleset: int, path: Path, access: int) -> None:
    opened = os.open(path, os.O_PATH | os.O_CLOEXEC)
    try:
        rule = _PathBeneath(access if path.is_dir() else access & _OF_ONE_FILE, opened)
        kernel.system_call(_ADD_RULE, ruleset, _RULE_PATH_BENEATH, _address(rule), 0)
    finally:
        os.close(opened)


def _address(structure: ctypes.Structure) -> ctypes.c_void_p:
    return ctypes.c_void_p(ctypes.addressof(structure))
