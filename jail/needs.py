"""What a child needs inside its jail; whatever is not named here it does not get."""

import stat
import sys
import sysconfig
from dataclasses import dataclass
from pathlib import Path

import jail

_OWN_PACKAGES = ("api_schemas", "jail", "trial_logs", "report_views", "sim_backend", "robot_farm", "services", "client_cli")
_OF_THE_SYSTEM = ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/etc/ld.so.cache", "/dev/null", "/dev/urandom")
_OF_THE_PROCESSOR = ("/proc/cpuinfo", "/sys/devices/system/cpu")


@dataclass(frozen=True)
class Needs:
    """Limits, and which files are opened once the jail is closed.

    Args:
        memory_bytes: of address space.
        cpu_s: of CPU time until the kernel ends the process; None where its parent sees to that.
        file_bytes: the largest file that it may write.
        open_files: descriptors at the same time.
        threads: at the same time; binds where the jail has a user of its own.
        installation: whether it reads the interpreter, the libraries and the farm's own code, and runs what it reads there.
        folder: the one folder in which it reads and writes; given to its user.
    """

    memory_bytes: int
    cpu_s: int | None = None
    file_bytes: int = 0
    open_files: int = 64
    threads: int = 16
    installation: bool = False
    folder: Path | None = None

    @property
    def files(self) -> bool:
        """Whether it opens files at all."""
        return self.installation or self.folder is not None

    @property
    def readable(self) -> tuple[Path, ...]:
        """What it may read besides its folder; not all that lies beside our packages, which may be a farm's data."""
        if not self.installation:
            return ()
        root = Path(jail.__file__).parent.parent
        own = [root / package for package in _OWN_PACKAGES]
        libraries = [Path(sysconfig.get_path(name)) for name in ("stdlib", "platstdlib", "purelib", "platlib")]
        given = [*own, *libraries, Path(sys.base_prefix) / "lib", *map(Path, _OF_THE_SYSTEM), *map(Path, _OF_THE_PROCESSOR)]
        return tuple(dict.fromkeys(path.resolve() for path in given if path.exists()))

    @property
    def writable(self) -> tuple[Path, ...]:
        """Where it may write."""
        return () if self.folder is None else (self.folder,)

    @property
    def open_to_others(self) -> bool:
        """Whether a user who owns nothing of it can read what is to be read; not so in an installation in root's home."""
        return all(_open_to_others(path) for path in self.readable)


def _open_to_others(path: Path) -> bool:
    wanted = stat.S_IROTH | (stat.S_IXOTH if path.is_dir() else 0)
    passable = all(parent.stat().st_mode & stat.S_IXOTH for parent in path.parents)
    return passable and path.stat().st_mode & wanted == wanted
