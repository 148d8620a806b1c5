"""The robots' own network: a namespace, a wire that carries the bus and can be cut or made to lose packets, and one for HTTP."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from chaos.link import HERE
from chaos.processes import Process, module, until

API_HERE, API_THERE = "10.199.1.1", "10.199.1.2"
HOLDS_THE_NAMESPACE = "import time; time.sleep(1e9)"


@dataclass(frozen=True)
class Wire:
    """The way between services and robots; HTTP and the bus have one each."""

    loss: Path
    holder: int
    api_host: str = API_HERE
    bus_host: str = HERE

    @property
    def on_the_other_side(self) -> tuple[str, ...]:
        """What a command begins with that is to run in the robots' network."""
        return ("nsenter", f"--net=/proc/{self.holder}/ns/net")

    def lose(self, share: float) -> None:
        """Has the bus lose this share of its packets: 0 none, 1 all."""
        unfinished = self.loss.with_suffix(".new")
        unfinished.write_text(str(share))
        unfinished.replace(self.loss)


@contextmanager
def wire(folder: Path, processes: dict[str, Process], seed: int) -> Iterator[Wire]:
    """Makes the robots' network; needs namespaces of our own, and goes with them."""
    loss = folder / "loss"
    loss.write_text("0")
    hold = ["unshare", "--net", sys.executable, "-c", HOLDS_THE_NAMESPACE]
    processes["network"] = holder = Process("network", hold, {}, folder / "network.log")
    holder.start()
    assert holder.running is not None
    pid = holder.running.pid
    until(lambda: _is_apart(pid), 10, "a network namespace for the robots")
    made = Wire(loss, pid)
    _ip("link", "add", "http-here", "type", "veth", "peer", "name", "http-there", "netns", str(pid))
    _ip("addr", "add", f"{API_HERE}/24", "dev", "http-here")
    _ip("link", "set", "http-here", "up")
    _ip("addr", "add", f"{API_THERE}/24", "dev", "http-there", before=made.on_the_other_side)
    for device in ("http-there", "lo"):
        _ip("link", "set", device, "up", before=made.on_the_other_side)
    carry = [*module("chaos"), "link", "--other", str(pid), "--loss", str(loss), "--seed", str(seed)]
    processes["wire"] = Process("wire", carry, {}, folder / "wire.log")
    processes["wire"].start()
    ping = [*made.on_the_other_side, "ip", "-br", "addr", "show", "wire-there"]
    until(lambda: subprocess.run(ping, capture_output=True, check=False).stdout != b"", 20, "the robots' end of the bus's wire")
    yield made


def _is_apart(pid: int) -> bool:
    return Path(f"/proc/{pid}/ns/net").readlink() != Path("/proc/self/ns/net").readlink()


def _ip(*arguments: str, before: tuple[str, ...] = ()) -> None:
    subprocess.run([*before, "ip", *arguments], check=True)
