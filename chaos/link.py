"""``python -m chaos link``: the wire between the services' network and the robots', which loses what it is told to lose.

It carries IP packets between two TUN devices, one in this process's network namespace and one in another, and drops each
packet with the probability that stands in a file: 1 is a cut wire.
"""

import argparse
import ctypes
import fcntl
import os
import random
import select
import struct
import subprocess
import time
from pathlib import Path

TUNSETIFF = 0x400454CA
IFF_TUN_NO_PI = 0x0001 | 0x1000
CLONE_NEWNET = 0x40000000
PACKET_BYTES = 65_536
LOOK_EVERY_S = 0.05
HERE, THERE = "10.199.2.1", "10.199.2.2"
"""Addresses of the two ends; both lie in networks that only the run can see."""


def main(arguments: list[str]) -> None:
    """Carries packets until killed."""
    parser = argparse.ArgumentParser(prog="python -m chaos link")
    parser.add_argument("--other", type=int, required=True, help="pid of a process in the other network namespace")
    parser.add_argument("--loss", type=Path, required=True, help="file with the probability of loss, from 0 to 1")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args(arguments)
    here = _open_end("wire-here", HERE, THERE)
    with Path(f"/proc/{given.other}/ns/net").open("rb") as namespace:
        if ctypes.CDLL(None, use_errno=True).setns(namespace.fileno(), CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), "the other network namespace cannot be entered")
    there = _open_end("wire-there", THERE, HERE)
    _carry(here, there, given.loss, random.Random(given.seed))


def _open_end(name: str, own: str, peer: str) -> int:
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, TUNSETIFF, struct.pack("16sH14x", name.encode(), IFF_TUN_NO_PI))
    subprocess.run(["ip", "addr", "add", own, "peer", peer, "dev", name], check=True)
    subprocess.run(["ip", "link", "set", name, "up"], check=True)
    return device


def _carry(here: int, there: int, loss_file: Path, chance: random.Random) -> None:
    other, looked_s, loss = {here: there, there: here}, 0.0, 0.0
    while True:
        ready, _, _ = select.select([here, there], [], [], LOOK_EVERY_S)
        if time.monotonic() - looked_s > LOOK_EVERY_S:
            loss, looked_s = float(loss_file.read_text() or 0), time.monotonic()
        for end in ready:
            packet = os.read(end, PACKET_BYTES)
            if chance.random() >= loss:
                try:
                    os.write(other[end], packet)
                except BlockingIOError:
                    continue  # a full queue loses packets, as a wire does
