"""What a child needs inside its jail; whatever is not named here it does not get."""

import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

import api_schemas

_LIBRARIES = ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/etc/ld.so.cache")
_DEVICES = ("/dev/null", "/dev/urandom")
_OWN_PACKAGES = ("api_schemas", "sim_backend", "robot_farm", "services", "client_cli")


@dataclass(frozen=True)
class Needs:
    """Limits, and whether and where files are opened once the jail is closed.

    Args:
        memory_bytes: of address space.
        cpu_s: of CPU time until the kernel ends the process; None where its parent sets that limit.
        file_bytes: the largest file that it may write.
        open_files: descriptors at the same time.
        threads: at the same time; binds where the jail has a user of its own.
        files: whether it opens files at all: the interpreter and its libraries for reading, and ``folder``.
        folder: the one folder in which it reads and writes; given to its user.
        executable_memory: whether it compiles, or loads libraries after the jail is closed.
    """

    memory_bytes: int
    cpu_s: int | None = None
    file_bytes: int = 0
    open_files: int = 64
    threads: int = 16
    files: bool = False
    folder: Path | None = None
    executable_memory: bool = False

    @property
    def readable(self) -> tuple[Path, ...]:
        """What it may read besides its folder; never the folder of the installation, which may hold a farm's data."""
        if not self.files:
            return ()
        root = Path(api_schemas.__file__).parent.parent
        own = [root / package for package in _OWN_PACKAGES]
        standard = [Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
        built_in = [Path(sys.base_prefix) / "lib"]
        return tuple(dict.fromkeys([*own, *standard, *built_in, *map(Path, (*_LIBRARIES, *_DEVICES))]))

    @property
    def writable(self) -> tuple[Path, ...]:
        """Where it may write."""
        return () if self.folder is None else (self.folder,)
