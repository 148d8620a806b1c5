"""One job by two versions of the code: are outcomes, measures and every channel of the logs the same bits?

``record --checkout CLONE --to FOLDER`` runs a job on a farm of that clone's code and fetches logs, truths and report;
``compare OLD NEW`` compares two such folders, prints a table and exits 1 on a difference. What is compared and what is not stands
beside the names of the fields below: only wall-clock times, ids that a farm draws anew for each job, and versions are left out.

One robot runs the trials of its job in their order, so that it comes to each trial as warm and as often tested as before. With
more robots the machine's speed decides who takes which trial, and two runs of the same code differ.
"""

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from mcap.reader import make_reader

POLICY = Path("sim_backend/training/reference_policies/push.safetensors")
POLICY_TOPIC = "/measured/policy"
INFERENCE_TIME_BYTES = 9
"""The end of a message of POLICY_TOPIC: one byte of the field's key and the wall-clock time of the inference in ns."""
EVENTS_TOPIC = "/measured/events"
"""Events name their trial by its id, which is taken out of them."""

REPORT_LEFT_OUT = {"job_id", "created_at", "started_at", "ended_at", "versions", "timing"}
"""Ids, wall-clock stamps, versions; ``timing`` sums up wall-clock times of inferences."""
ROW_LEFT_OUT = {"trial_id", "log_sha256"}
"""An id; and the digest of a file that holds ids and wall-clock times, whose content is compared instead."""
OUTCOME_LEFT_OUT = {"wall_s", "policy_timing"}
"""Wall-clock times."""
TRIAL_LEFT_OUT = {"job_id", "trial_id", "versions", "began_at"}
"""Of a log's record of its trial."""
LEFT_OUT = (
    "wall-clock times (inference times, wall_s, policy_timing, timing, *_at), ids of job and trial, versions, "
    "log_sha256 (the files hold those), the order of different channels' messages and the compression"
)


@dataclass(frozen=True)
class Recorded:
    """A log or a truth file: parts of it by name, each as (how many messages or records, a digest of all their bits)."""

    parts: dict[str, tuple[int, str]]


def recorded(path: Path) -> Recorded:
    """Read a file of a trial.

    A channel's part covers the name, encoding and text of its schema and, of each message in order, the log time and the publish
    time, which are simulated, and all bytes but inference times and ids.
    """
    hashes, counts = defaultdict(hashlib.sha256), defaultdict(int)
    with path.open("rb") as stream:
        reader = make_reader(stream)
        records = [(record.name, record.metadata) for record in reader.iter_metadata()]
        trial_id = dict(records)["trial"]["trial_id"].encode()
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            name = channel.topic
            if not counts[name]:
                assert schema is not None, f"{path}: {name} has no schema"
                head = (channel.message_encoding, schema.name, schema.encoding, hashlib.sha256(schema.data).hexdigest())
                hashes[name].update(repr(head).encode())
            counts[name] += 1
            data = _comparable(name, message.data, trial_id)
            hashes[name].update(f"{message.log_time} {message.publish_time} {len(data)} ".encode() + data)
        for attachment in reader.iter_attachments():
            name = f"attachment {attachment.name}"
            counts[name] += 1
            hashes[name].update(f"{attachment.media_type} {attachment.log_time} ".encode() + attachment.data)
        for record, values in records:
            name = f"metadata {record}"
            counts[name] += 1
            hashes[name].update(json.dumps(_metadata(record, values), sort_keys=True).encode())
    return Recorded({name: (counts[name], hashes[name].hexdigest()) for name in counts})


def _comparable(topic: str, data: bytes, trial_id: bytes) -> bytes:
    if topic == POLICY_TOPIC:
        return data[:-INFERENCE_TIME_BYTES]
    return data.replace(trial_id, b"") if topic == EVENTS_TOPIC else data


def _metadata(name: str, values: dict[str, str]) -> dict[str, str]:
    left_out = {"trial": TRIAL_LEFT_OUT, "outcome": OUTCOME_LEFT_OUT}.get(name, set())
    return {key: value for key, value in values.items() if key not in left_out}


def differences_of_reports(old: dict[str, Any], new: dict[str, Any]) -> Iterator[str]:
    """Where two reports differ: ``path: old != new``."""
    yield from _differences("report", _without(old), _without(new))


def _without(report: dict[str, Any]) -> dict[str, Any]:
    kept = {key: value for key, value in report.items() if key not in REPORT_LEFT_OUT}
    rows = [{key: value for key, value in row.items() if key not in ROW_LEFT_OUT} for row in report["per_trial"]]
    for row in rows:
        row["outcome"] = {key: value for key, value in row["outcome"].items() if key not in OUTCOME_LEFT_OUT}
    return kept | {"per_trial": rows}


def _differences(path: str, old: Any, new: Any) -> Iterator[str]:
    if isinstance(old, dict) and isinstance(new, dict):
        for key in sorted({*old, *new}):
            if key not in old or key not in new:
                yield f"{path}.{key}: only in the {'old' if key in old else 'new'} one"
            else:
                yield from _differences(f"{path}.{key}", old[key], new[key])
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        for index, pair in enumerate(zip(old, new, strict=True)):
            yield from _differences(f"{path}[{index}]", *pair)
    elif json.dumps(old) != json.dumps(new):
        yield f"{path}: {json.dumps(old)[:80]} != {json.dumps(new)[:80]}"


@dataclass(frozen=True)
class Comparison:
    """What two folders have in common: of each part in how many files it was compared, its messages, and what differs."""

    rows: dict[str, tuple[int, int, int]]
    """Part -> (files, messages, files in which it differs)."""
    differences: tuple[str, ...]


def compared(old: Path, new: Path) -> Comparison:
    """Compare two folders of fetched results."""
    rows: dict[str, tuple[int, int, int]] = {}
    reports = [json.loads((folder / "report.json").read_text()) for folder in (old, new)]
    differences = list(differences_of_reports(*reports))
    rows["report.json"] = (1, len(reports[0]["per_trial"]), int(bool(differences)))
    names = [sorted(path.name for path in folder.glob("*.mcap")) for folder in (old, new)]
    differences += [f"{name}: only in one of the folders" for name in sorted(set(names[0]) ^ set(names[1]))]
    if not names[0]:
        differences.append(f"{old}: holds no logs")
    for name in sorted(set(names[0]) & set(names[1])):
        kind = "truth" if name.endswith(".truth.mcap") else "log"
        before, after = recorded(old / name).parts, recorded(new / name).parts
        for part in sorted({*before, *after}):
            same = before.get(part) == after.get(part)
            row = f"{kind} {part}"
            files, messages, wrong = rows.get(row, (0, 0, 0))
            rows[row] = (files + 1, messages + before.get(part, (0, ""))[0], wrong + (not same))
            if not same:
                counts = " != ".join(str(parts.get(part, (0, ""))[0]) for parts in (before, after))
                differences.append(f"{name} {part}: other bits (messages {counts})")
    return Comparison(rows, tuple(differences))


def table(comparison: Comparison) -> str:
    """A comparison for people."""
    lines = [f"{'compared':46s} {'files':>6s} {'messages':>9s} {'differ':>7s}"]
    lines += [f"{name:46s} {files:6d} {messages:9d} {wrong:7d}" for name, (files, messages, wrong) in comparison.rows.items()]
    lines += ["", f"not compared: {LEFT_OUT}", *comparison.differences[:20]]
    if len(comparison.differences) > 20:
        lines.append(f"… and {len(comparison.differences) - 20} more")
    return "\n".join([*lines, "the same bits" if not comparison.differences else "DIFFERENT"])


@contextmanager
def farm(checkout: Path, python: str, home: Path, options: list[str], **settings: str) -> Iterator[dict[str, str]]:
    """A farm of a clone's code, told ``settings`` by its environment; gives the environment in which its ``trifarm`` finds it."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("TRIFARM_")}
    environment |= {"PYTHONPATH": str(checkout), "TRIFARM_HOME": str(home)} | settings
    home.mkdir(parents=True)
    with (home / "up.log").open("wb") as said:
        command = [python, "-m", "client_cli", "up", "--port", "0", "--data", str(home / "farm"), *options]
        process = subprocess.Popen(command, cwd=home, env=environment, stdout=said, stderr=said)
    try:
        ends = time.monotonic() + 120
        while b"The farm is up" not in (home / "up.log").read_bytes():
            assert process.poll() is None and time.monotonic() < ends, (home / "up.log").read_text()
            time.sleep(0.1)
        yield environment
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(30)


def record(checkout: Path, to: Path, python: str, *, physics: str, trials: int, farm_seed: int, seed: int) -> Path:
    """Run a job on one robot of a clone's farm.

    Returns:
        The folder with report, logs and truths; beside it are the farm's HTTP document and what was run.
    """
    checkout, to = checkout.resolve(), to.resolve()
    to.mkdir(parents=True)
    options = ["--robots", "1", "--physics", physics, "--farm-seed", str(farm_seed)]
    with farm(checkout, python, to / "home", options) as environment:

        def trifarm(*arguments: str) -> str:
            command = [python, "-m", "client_cli", *arguments]
            return subprocess.run(command, cwd=to, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout

        ran = [python, "-c", "import client_cli; print(client_cli.__file__)"]
        where = subprocess.run(ran, cwd=to, env=environment, check=True, stdout=subprocess.PIPE, text=True).stdout.strip()
        assert Path(where).is_relative_to(checkout), f"{where} would run, not the code of {checkout}"
        wish = ["--task", "push", "--trials", str(trials), "--seed", str(seed), "--wait"]
        job_id = trifarm("submit", str(checkout / POLICY), *wish).split()[0]
        trifarm("fetch", job_id, "--to", str(to / "results"), "--truth")
        settings = json.loads((to / "home" / "settings.json").read_text())
        answer = httpx.get(f"{settings['url']}/openapi.json", headers={"Authorization": f"Bearer {settings['token']}"})
        (to / "openapi.json").write_text(json.dumps(answer.raise_for_status().json(), indent=1, sort_keys=True) + "\n")
    commit = subprocess.run(
        ["git", "describe", "--always", "--dirty"], cwd=checkout, stdout=subprocess.PIPE, text=True, check=True
    )
    what = {"commit": commit.stdout.strip(), "physics": physics, "robots": 1, "trials": trials}
    (to / "recorded.json").write_text(json.dumps(what | {"farm_seed": farm_seed, "seed": seed}, indent=2) + "\n")
    return to / "results"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record", help="run a job on a farm of a clone's code and fetch everything of it")
    recording.add_argument("--checkout", type=Path, required=True, metavar="CLONE")
    recording.add_argument("--to", type=Path, required=True, metavar="FOLDER", help="a folder that is not there yet")
    recording.add_argument("--python", default=sys.executable, help="the interpreter, with the libraries that the clone needs")
    recording.add_argument("--physics", default="real")
    recording.add_argument("--trials", type=int, default=40)
    recording.add_argument("--farm-seed", type=int, default=7001)
    recording.add_argument("--seed", type=int, default=5)
    comparing = commands.add_parser("compare", help="compare two folders of fetched results")
    comparing.add_argument("old", type=Path)
    comparing.add_argument("new", type=Path)
    asked = parser.parse_args()
    if asked.command == "compare":
        comparison = compared(asked.old, asked.new)
        print(table(comparison))
        return 1 if comparison.differences else 0
    options = {name: getattr(asked, name) for name in ("physics", "trials", "farm_seed", "seed")}
    print(record(asked.checkout, asked.to, asked.python, **options))
    return 0


if __name__ == "__main__":
    sys.exit(main())
