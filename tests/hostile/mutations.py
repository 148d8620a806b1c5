"""Random mutations of valid files of each kind against the server's checks: ``python -m tests.hostile.mutations``.

Each mutation goes the way of an upload, through the pre-check and the converting child. Every answer must be a typed refusal or
an acceptance whose graph gives nine numbers; some of the accepted run in a robot's own policy process as well.
The child is forked from this process, which has loaded what it needs, so that a thousand take minutes; it is limited as always.
What a child costs with its start-up is measured apart, on a valid file of each kind.
"""

import argparse
import asyncio
import json
import os
import platform
import signal
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import onnx
import onnxruntime
import safetensors.numpy  # noqa: F401  loaded here, so that no fork loads it again

from api_schemas.policy import MAX_WEIGHTS_BYTES, WeightsFormat, canonical_json
from jail.level import JailLevel
from robot_farm.policy.jail import JailedPolicy
from services.child_process import Ended
from services.errors import ServiceError
from services.policies import conversion, dry_run, graph, intake, jailed_conversion, recorded, sb3_network, uploaded  # noqa: F401
from tests.hostile.measured import measured_children
from tests.hostile.valid import MANIFEST, VALID, sb3_entries, torch_entries, zipped

ROBOT_EVERY = 50
"""Of the accepted, every so many are run by a robot's own process."""
HANGS_S = 60


@dataclass
class Tally:
    """What became of the mutations of one kind."""

    outcomes: Counter = field(default_factory=Counter)
    problems: Counter = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    check_cpu_s: float = 0.0
    child_cpu_s: float = 0.0
    child_memory_bytes: int = 0
    run_by_a_robot: int = 0

    def document(self):
        """As JSON."""
        return {
            **{name: self.outcomes[name] for name in ("refused_before_parsing", "refused_by_converter", "accepted", "unchanged")},
            "problems": dict(sorted(self.problems.items())),
            "faults": self.faults,
            "run_by_a_robot": self.run_by_a_robot,
            "largest_cpu_s_before_parsing": round(self.check_cpu_s, 4),
            "largest_cpu_s_of_converter": round(self.child_cpu_s, 3),
            "largest_memory_mb_of_converter": round(self.child_memory_bytes / 2**20),
        }


def mutated(content, rng):
    """The content with one to four changes, most of them where a file says what it is, at its beginning and its end."""
    data = bytearray(content)
    for _ in range(rng.integers(1, 5)):
        at = position(len(data), rng)
        length = int(rng.integers(1, 33))
        match rng.integers(8):
            case 0 | 1:
                data[at] ^= 1 << int(rng.integers(8))
            case 2:
                data[at] = int(rng.choice([0, 1, 0x7F, 0x80, 0xFF, ord("/"), ord("."), ord("9")]))
            case 3:
                data[at : at + length] = rng.bytes(length)
            case 4:
                del data[at : at + length]
            case 5:
                data[at:at] = data[at : at + length]
            case 6:
                data[at : at + 4] = int(rng.choice([0, 1, 2**31 - 1, 2**32 - 1])).to_bytes(4, "little")
            case 7 if rng.integers(4) == 0:
                del data[at:]
        if not data:
            break
    return bytes(data)


def of_kind(kind):
    """How a file of a kind is made and mutated: a function of seed and generator that gives the valid and the mutated one."""

    def whole(seed, rng):
        valid = VALID[kind](seed)
        return valid, mutated(valid, rng)

    return whole


def inside_archive(seed, rng):
    """A mutation of one entry of an archive, or of one within its policy.pth, with all checksums as they must be."""
    entries = sb3_entries(seed)
    valid = zipped(entries)
    if rng.integers(2):
        entries["data"] = mutated(entries["data"], rng)
    else:
        inner = torch_entries(seed)
        name = "archive/data.pkl" if rng.integers(2) else str(rng.choice(list(inner)))
        inner[name] = mutated(inner[name], rng)
        entries["policy.pth"] = zipped(inner)
    return valid, zipped(entries)


KINDS = {kind: (kind, of_kind(kind)) for kind in VALID} | {"inside_zip": ("zip", inside_archive)}
"""By name: the end of the file's name, and what makes it."""


def position(size, rng):
    """Where to change something."""
    edge = min(size, 600)
    match rng.integers(4):
        case 0:
            return int(rng.integers(edge))
        case 1:
            return size - 1 - int(rng.integers(edge))
        case _:
            return int(rng.integers(size))


def forked(work, folder):
    """Runs ``work`` in a process of its own; gives how it ended with what it printed, its CPU time and its memory."""
    read_fd, write_fd = os.pipe()
    pid = os.fork()
    if pid == 0:
        status = 1
        try:
            os.dup2(write_fd, 1)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            signal.alarm(HANGS_S)
            os.chdir(folder)
            work()
            status = 0
        finally:
            os._exit(status)
    os.close(write_fd)
    with os.fdopen(read_fd, "rb") as pipe:
        said = pipe.read()
    _, status, used = os.wait4(pid, 0)
    return Ended(os.waitstatus_to_exitcode(status), said), used.ru_utime + used.ru_stime, used.ru_maxrss * 1024


def try_one(content, kind, folder, tally, label):
    """Goes the way of an upload and counts."""
    path, manifest, out = folder / f"weights.{kind}", folder / "manifest.json", folder / "policy.onnx"
    path.write_bytes(content)
    manifest.write_text(canonical_json(MANIFEST))
    out.unlink(missing_ok=True)
    began_s = time.process_time()
    try:
        intake.check_weights(path, WeightsFormat(kind), MAX_WEIGHTS_BYTES)
    except ServiceError as error:
        return count_refusal(tally, "refused_before_parsing", error, label)
    finally:
        tally.check_cpu_s = max(tally.check_cpu_s, time.process_time() - began_s)
    sys.argv = ["conversion", str(path), str(manifest), out.name, JailLevel.NONE.value, str(MAX_WEIGHTS_BYTES)]
    ended, cpu_s, memory_bytes = forked(conversion.main, folder)
    tally.child_cpu_s = max(tally.child_cpu_s, cpu_s)
    tally.child_memory_bytes = max(tally.child_memory_bytes, memory_bytes)
    if ended.status not in (0, -signal.SIGPROF):
        tally.faults.append(f"{label}: the converter {ended.how}")
    try:
        jailed_conversion._read(ended, out, path.name)
    except ServiceError as error:
        return count_refusal(tally, "refused_by_converter", error, label)
    tally.outcomes["accepted"] += 1
    ended, _, _ = forked(lambda: run_graph(out), folder)
    if ended.status != 0:
        tally.faults.append(f"{label}: accepted, but its graph does not run ({ended.how})")
    if tally.outcomes["accepted"] % ROBOT_EVERY == 1:
        run_by_robot(out, tally, label)
    return None


def whole_child(content, suffix, folder):
    """What a child costs that starts from nothing and takes the file."""
    path = folder / f"weights.{suffix}"
    path.write_bytes(content)
    with measured_children() as cost:
        asyncio.run(jailed_conversion.convert(path, MANIFEST, folder, HANGS_S))
    return {
        "cpu_s_of_a_whole_converter": round(cost.cpu_s, 3),
        "memory_mb_of_a_whole_converter": round(cost.memory_bytes / 2**20),
    }


def count_refusal(tally, outcome, error, label):
    """Counts a refusal; one that is no typed 4xx with all its members is a fault."""
    tally.outcomes[outcome] += 1
    tally.problems[error.slug] += 1
    if not 400 <= error.status < 500 or not {"file", "part", "instead"} <= set(error.members):
        tally.faults.append(f"{label}: {error.status} {error.slug} with {sorted(error.members)}")


def run_graph(path):
    """Raises unless the graph gives nine numbers for each of a few observations."""
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    for observation in recorded.observations(MANIFEST)[::20]:
        (action,) = session.run(["action"], {"observation": observation[None, :]})
        assert action.shape == (1, 9)


def run_by_robot(path, tally, label):
    """The same in a robot's own policy process; an action that is not finite ends a trial there, and is no fault of ours."""
    with JailedPolicy(label, path) as policy:
        try:
            policy.reset()
            policy.act(recorded.observations(MANIFEST)[0])
        except Exception as error:
            if "not finite" not in str(error):
                tally.faults.append(f"{label}: accepted, but a robot says {error}")
    tally.run_by_a_robot += 1


def main():
    """Writes what became of all mutations; ends with 1 where an answer was not what it must be."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="mutations of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True, help="the result, as JSON")
    given = parser.parse_args()
    tallies, whole = {kind: Tally() for kind in KINDS}, {}
    with tempfile.TemporaryDirectory(prefix="trifarm-mutations-") as name:
        for number, (kind, tally) in enumerate(tallies.items()):
            (suffix, make), rng = KINDS[kind], np.random.default_rng([given.seed, number])
            for each in range(given.count):
                valid, content = make(each % 3, rng)
                if content == valid:
                    tally.outcomes["unchanged"] += 1
                try_one(content, suffix, Path(name), tally, f"{kind} {each}")
            whole[kind] = whole_child(make(0, rng)[0], suffix, Path(name))
            sys.stderr.write(f"{kind}: {dict(tally.outcomes)}, {len(tally.faults)} faults\n")
    versions = {"python": platform.python_version(), "onnx": onnx.__version__, "onnxruntime": onnxruntime.__version__}
    document = {"format": "trifarm-hostile-mutations/1", "count": given.count, "seed": given.seed, "versions": versions}
    document["kinds"] = {kind: tally.document() | whole[kind] for kind, tally in tallies.items()}
    given.out.write_text(json.dumps(document, indent=2) + "\n")
    return 1 if any(tally.faults for tally in tallies.values()) else 0


if __name__ == "__main__":
    sys.exit(main())
