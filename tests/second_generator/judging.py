"""Ask ``trifarm gap study`` about every made case, as a user does, and keep the answers as given."""

import json
import os
import resource
import signal
import subprocess
import sys
import time
from pathlib import Path

ANSWERED = {0, 2}
"""Exit codes that are an answer: a verdict, or data refused."""
KEPT = ("verdict", "summary", "causes", "held_out", "null_p", "runner_up", "follows", "cannot_tell", "record_next")


def answered(path):
    """Names of the cases that have an answer in a file of answers."""
    if not path.is_file():
        return set()
    rows = (json.loads(line) for line in path.read_text().splitlines() if line)
    return {row["case"] for row in rows if row["exit_code"] in ANSWERED}


def ask(folder, results, command, limit_s, method=None):
    """The answer to one case: the study's JSON document, exit code, seconds, and the last lines of what it said on stderr.

    Without a method the tool takes its own, as it does for users. Besides seconds of the clock a row has those of the processor.
    """
    begin, used = time.monotonic(), _used_by_children_s()
    call = [*command, "gap", "study", str(folder / "study.toml"), "--out", str(results), "--json"]
    call += [] if method is None else ["--method", method]
    with subprocess.Popen(
        call, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8", start_new_session=True
    ) as process:
        try:
            said, errors = process.communicate(timeout=limit_s)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            said, errors = process.communicate()
            errors += f"\nstopped after {limit_s:g} s"
    row = {"case": folder.name, "exit_code": process.returncode, "seconds": round(time.monotonic() - begin, 1)}
    row["cpu_s"] = round(_used_by_children_s() - used, 1)
    return row | read_answer(said, process.returncode) | {"stderr": errors.strip().splitlines()[-3:]}


def read_answer(said, exit_code):
    """The parts of a study's JSON document that are scored or read later; all others are named under ``more``."""
    if exit_code != 0:
        return {"verdict": None, "causes": []}
    document = json.loads(said)
    kept = {key: document.get(key) for key in KEPT}
    return kept | {"more": {key: value for key, value in document.items() if key not in KEPT and key != "files"}}


def _used_by_children_s():
    """Seconds of the processor of all processes that were waited for."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def judge(root, out, command=None, limit_s=3600.0, say=print, method=None):
    """Ask about every case below ``root`` that has no answer in ``out`` yet; each line of JSON is there as soon as its answer."""
    command = command or [str(Path(sys.executable).parent / "trifarm")]
    done = answered(out)
    (root / "answers").mkdir(exist_ok=True)
    folders = sorted(path for path in (root / "cases").iterdir() if (root / "truth" / f"{path.name}.json").is_file())
    for folder in folders:
        if folder.name not in done:
            row = ask(folder, root / "answers" / folder.name, command, limit_s, method)
            with out.open("a") as lines:
                lines.write(json.dumps(row) + "\n")
            say(f"{row['case']} {row['verdict']} exit {row['exit_code']} {row['seconds']} s, {row['cpu_s']} s of CPU")
