"""A whole farm on a small disk: logs, database, files and robots on 40 or 60 MB, until it is full, and with room again.

``python -m tests.benchmarks.full_disk --out results/full-disk.json`` (as root, on Linux): for each size, in namespaces of its
own, ``trifarm up`` on a tmpfs of that size. Somebody else takes every byte that is left while trials run and gives it back; then
trials until nothing is done any more, every byte taken again, and then a larger disk. What is to hold: the farm lives, no robot
is blamed, status names the disk, and all trials are done once there is room.
"""

import argparse
import json
import os
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import httpx

SIZES_MB = (40, 60)
TRIALS = 24
STILL_S = 20.0
"""So long without another trial done, and with none running, the farm has stopped taking leases."""
TAKEN_S = 15.0
READY_WITHIN_S = 120.0
WITHIN_S = 420.0
WITH_ROOM = "size=1000m"
HERE = "TRIFARM_FULL_DISK_HERE"
BALLAST_BYTES = 1 << 16


def main() -> None:
    """Measures each size in a process and mount namespace of its own."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--mb", type=int, nargs="*", default=SIZES_MB)
    parser.add_argument("--physics", default="real")
    given = parser.parse_args()
    if os.environ.get(HERE):
        print(json.dumps(on_disk(given.mb[0], given.physics)))
        return
    runs = []
    for size_mb in given.mb:
        command = ["unshare", "--mount", "--pid", "--fork", "--kill-child", "--mount-proc", sys.executable, "-m", __spec__.name]
        flags = ["--out", str(given.out), "--physics", given.physics, "--mb", str(size_mb)]
        ended = subprocess.run([*command, *flags], env=os.environ | {HERE: "1"}, stdout=subprocess.PIPE, text=True, check=False)
        runs.append(json.loads(ended.stdout) if ended.returncode == 0 else {"disk_mb": size_mb, "failed": ended.stdout[-500:]})
        given.out.write_text(json.dumps({"trials": TRIALS, "physics": given.physics, "runs": runs}, indent=1) + "\n")
        print(json.dumps(runs[-1]), file=sys.stderr)


def on_disk(size_mb: int, physics: str) -> dict[str, Any]:
    """One farm on a disk of this size."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        disk, home = Path(folder) / "disk", Path(folder) / "home"
        disk.mkdir()
        home.mkdir()
        subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size_mb}m", "tmpfs", str(disk)], check=True)
        environment = {name: value for name, value in os.environ.items() if not name.startswith("TRIFARM_")} | {
            "TRIFARM_HOME": str(home)
        }
        # The farm's own words go to the disk, too, as those of a service of the system do.
        with (disk / "up.log").open("ab") as words:
            up = subprocess.Popen(
                [*_trifarm(), "up", "--data", str(disk / "farm"), "--port", "0", "--robots", "4", "--physics", physics],
                env=environment,
                stdout=words,
                stderr=words,
            )
        try:
            return {"disk_mb": size_mb} | _filled(up, disk, home, environment)
        finally:
            up.send_signal(signal.SIGTERM)
            up.wait(20)


def _filled(up: subprocess.Popen[bytes], disk: Path, home: Path, environment: dict[str, str]) -> dict[str, Any]:
    http = _connection(up, home, disk / "up.log")
    submitted = subprocess.run(
        [*_trifarm(), "submit", "builtin:grasp", "--task", "push", "--trials", str(TRIALS)],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    job_id = submitted.stdout.split()[-1]
    began_s, ballast = time.monotonic(), disk / "ballast"
    while _job(http, job_id)["trials_done"] < 1 and up.poll() is None and time.monotonic() - began_s < WITHIN_S:
        time.sleep(0.2)
    refused_running = _taken_away(http, ballast)
    ballast.unlink()
    done_full, said_full = _until_still(http, job_id, up)
    refused = _taken_away(http, ballast)
    said_taken = http.get("/v1/status").json()["problems"]
    ballast.unlink()
    subprocess.run(["mount", "-o", f"remount,{WITH_ROOM}", str(disk)], check=True)
    roomy_s = time.monotonic()
    job = _job(http, job_id)
    while job["state"] in {"queued", "running"} and time.monotonic() - roomy_s < WITHIN_S:
        time.sleep(1.0)
        job = _job(http, job_id)
    trials = http.get(f"/v1/jobs/{job_id}/trials").json()["trials"]
    faulted = [each for trial in trials for each in trial["attempts"] if each["state"] == "platform_fault"]
    robots = http.get("/v1/robots").json()["robots"]
    return {
        "farm_alive": up.poll() is None,
        "done_on_small_disk": done_full,
        "status_when_full": said_full,
        "answers_when_taken_while_trials_run": refused_running,
        "answers_when_taken": refused,
        "status_when_taken": said_taken,
        "done": job["trials_done"],
        "state": job["state"],
        "platform_faults": len(faulted),
        "reasons": sorted({each["reason"] for each in faulted})[:10],
        "robots": {each["robot"]: each["state"] for each in robots},
        "status_after": http.get("/v1/status").json()["problems"],
        "counted_against_robots": _counted(disk / "farm" / "farm.sqlite"),
        "full_after_s": round(roomy_s - began_s, 1),
        "done_after_room_s": round(time.monotonic() - roomy_s, 1),
    }


def _until_still(http: httpx.Client, job_id: str, up: subprocess.Popen[bytes]) -> tuple[int, list[str]]:
    """Waits until the disk has stopped the farm; gives how many trials are done then, and what the status says."""
    since_s, done = time.monotonic(), -1
    while time.monotonic() - since_s < STILL_S and up.poll() is None:
        job = _job(http, job_id)
        if job["trials_done"] != done or job["trials_running"]:
            since_s, done = time.monotonic(), job["trials_done"]
        if job["state"] not in {"queued", "running"}:
            break
        time.sleep(0.5)
    return done, http.get("/v1/status").json()["problems"]


def _taken_away(http: httpx.Client, ballast: Path) -> dict[str, int]:
    """Somebody else takes every byte for a while, and users ask for more; gives what they were answered, by status and type."""
    answers: dict[str, int] = {}
    body = {"policy": http.get("/v1/policies").json()["policies"][0]["digest"], "task": "push", "trials": 1}
    ends_s = time.monotonic() + TAKEN_S
    while time.monotonic() < ends_s:
        with ballast.open("ab", buffering=0) as file:
            for size in (BALLAST_BYTES, 4096, 1):
                with suppress(OSError):
                    while True:
                        file.write(bytes(size))
        answer = http.post("/v1/jobs", json=body)
        said = f"{answer.status_code} {answer.json().get('type', '')}"
        answers[said] = answers.get(said, 0) + 1
        time.sleep(0.5)
    return answers


def _connection(up: subprocess.Popen[bytes], home: Path, words: Path) -> httpx.Client:
    settings = home / "settings.json"
    ends_s = time.monotonic() + READY_WITHIN_S
    while not settings.exists() and time.monotonic() < ends_s and up.poll() is None:
        time.sleep(0.2)
    if not settings.exists():
        raise SystemExit(words.read_text())
    told = json.loads(settings.read_text())
    return httpx.Client(base_url=told["url"], headers={"Authorization": f"Bearer {told['token']}"}, timeout=20, trust_env=False)


def _job(http: httpx.Client, job_id: str) -> dict[str, Any]:
    return http.get(f"/v1/jobs/{job_id}").json()


def _counted(database: Path) -> int:
    """Faults that the farm has counted against trials and robots, and robots that it withdrew for them."""
    with sqlite3.connect(f"file:{database}?mode=ro", uri=True) as connection:
        ((faults,),) = connection.execute("SELECT coalesce(sum(faults), 0) FROM trial")
        ((withdrawn,),) = connection.execute("SELECT count(*) FROM robot WHERE withdrawn IS NOT NULL OR faults_in_a_row > 0")
        return faults + withdrawn


def _trifarm() -> list[str]:
    return [str(Path(sys.executable).with_name("trifarm"))]


if __name__ == "__main__":
    main()
