"""schemathesis against the OpenAPI document that a real services process serves: no 5xx, nothing that the document does not say.

``python -m tests.hostile.fuzz_api --examples 40 --seed 1 --out FILE`` runs it twice, with ids as the document allows them (most
exist nowhere) and with ids of things that exist, and keeps the counts. Exit code 1 tells that something was found.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from collections import Counter
from importlib.metadata import version
from pathlib import Path

from tests.integration.farm_process import services

RUNS = ("as_served", "with_existing_ids", "revoking")
CHECKS = (
    "not_a_server_error",
    "status_code_conformance",
    "content_type_conformance",
    "response_headers_conformance",
    "response_schema_conformance",
    "negative_data_rejection",
    "missing_required_header",
    "unsupported_method",
    "allow_header_conformance",
    "ignored_auth",
)
REVOKING = "/v1/tokens/{token_id}"
"""schemathesis asks for ids that it was shown, its own token's among them: this path has a run and a token of its own."""
REPORTED, MOST_SAID = 10, 1500
SETTINGS = {
    "shares": "true",
    "requests_per_s": 0,
    "anonymous_requests_per_s": 0,
    "robot_requests_per_s": 0,
    "max_log_bytes": 100_000,
}
"""How often one may ask is not what is tried here."""


def things(farm):
    """Something behind every kind of id: a job that has ended, its trials and log, one that is cancelled, robots, tokens."""
    farm.start_robots(2, trial_s=0.02, truth=True)
    policy = farm.policy()
    done = farm.submit(policy, trials=2).json()["job_id"]
    identified = farm.identify(excitations=["chirps"]).json()["job_id"]
    for job_id in (done, identified):
        farm.wait_for_end(job_id)
    for robot in farm.robots:
        farm.admin.post(f"/v1/robots/{robot}/drain")
    cancelled = farm.submit(policy, trials=2).json()["job_id"]
    farm.admin.post(f"/v1/jobs/{cancelled}/cancel")
    rungs = [{"policy": policy, "step": 1}]
    ladder = farm.admin.post("/v1/ladders", json={"name": "l", "task": "push", "trials": 1, "rungs": rungs}).json()
    farm.admin.post(f"/v1/jobs/{ladder['rungs'][0]['job_id']}/cancel")
    made = [farm.admin.post("/v1/tokens", json={"owner": "ann", "scopes": ["submit"]}).json() for _ in range(3)]
    shares = [farm.admin.post("/v1/shares", json={"job": done}).json() for _ in range(3)]
    jobs = [done, identified, cancelled]
    return {
        "job_id": jobs,
        "trial_id": [f"{job_id}-000" for job_id in jobs],
        "ladder_id": [ladder["ladder_id"]],
        "task": ["push"],
        "digest": [policy],
        "token_id": [token["token_id"] for token in made],
        "share_id": [share["share_id"] for share in shares],
        "robot": sorted(farm.robots),
        "ordinal": [0, 1],
        "fence": [1, 2],
        "name": ["grasp"],
    }


def with_ids(document, ids):
    """The document, with the ids of what exists for the parameters of its paths."""
    for path in document["paths"].values():
        for operation in path.values():
            for parameter in operation.get("parameters", ()):
                if parameter["in"] == "path":
                    parameter["schema"] = {"enum": ids[parameter["name"]]}
    return document


def fuzz(farm, document, token, *, examples, seed, phases, checks=CHECKS, paths=("--exclude-path", REVOKING)):
    """One run: what was asked how often, how it was answered, and what was wrong."""
    with tempfile.TemporaryDirectory() as folder:
        stored, events = Path(folder) / "openapi.json", Path(folder) / "events.ndjson"
        stored.write_text(json.dumps(document))
        command = [sys.executable, "-m", "schemathesis.cli", "run", str(stored), "--url", farm.api]
        command += ["--header", f"Authorization: Bearer {token}", "--checks", ",".join(checks), "--phases", phases]
        command += ["--max-examples", str(examples), "--seed", str(seed), "--generation-database", "none", "--no-color"]
        command += ["--report", "ndjson", "--report-ndjson-path", str(events), "--warnings", "off", "--continue-on-failure"]
        command += [*paths, "--suppress-health-check", "all", "--request-timeout", "60", "--no-shrink"]
        started = time.monotonic()
        ended = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
        assert farm.process.poll() is None, "the services ended"
        return {"seconds": round(time.monotonic() - started, 1), "exit_code": ended.returncode, **counted(events, ended)}


def counted(events, ended):
    if not events.exists():
        return {
            "operations": 0,
            "never_succeeded": [],
            "cases": 0,
            "statuses": {},
            "failures": {"schemathesis": 1},
            "said": ended.stdout + ended.stderr,
        }
    operations, statuses, failures, said = {}, Counter(), Counter(), []
    for line in events.read_text().splitlines():
        look(json.loads(line), operations, statuses, failures, said)
    return {
        "operations": len(operations),
        "never_succeeded": sorted(label for label, succeeded in operations.items() if not succeeded),
        "cases": sum(statuses.values()),
        "statuses": dict(sorted(statuses.items())),
        "failures": dict(failures),
        "said": said[:REPORTED],
    }


def look(event, operations, statuses, failures, said):
    """Takes what one event of the run tells: asked, answered, found."""
    (kind, told), *_ = event.items()
    if kind in ("NonFatalError", "FatalError"):
        failures[kind] += 1
        said.append(json.dumps(told)[:MOST_SAID])
    if kind != "ScenarioFinished" or "recorder" not in told:
        return
    recorder = told["recorder"]
    answers = recorder.get("interactions", {})
    codes = [str((answer["response"] or {"status_code": "none"})["status_code"]) for answer in answers.values()]
    statuses.update(codes)
    if answers and told["phase"] != "stateful":
        operations[recorder["label"]] = operations.get(recorder["label"], False) or any(code[0] == "2" for code in codes)
    for case, checks in recorder.get("checks", {}).items():
        for check in checks:
            if check["status"] != "success":
                failures[check["name"]] += 1
                said.append(f"{recorder['label']}: {json.dumps(check)[:MOST_SAID]}: {json.dumps(answers.get(case))[:MOST_SAID]}")


def passes(farm, token, **how):
    """All runs: with the document as it is served, with ids of what exists in it, and what may end the asker's token."""
    ids = things(farm)
    served = farm.client(token).get("/openapi.json").json()
    as_served = fuzz(farm, served, token, **how)
    # What is not in a list of existing ids is no wrong id, so that it need not be refused.
    checks = [each for each in CHECKS if each != "negative_data_rejection"]
    existing = fuzz(farm, with_ids(served, ids), token, checks=checks, **how)
    spare = farm.admin.post("/v1/tokens", json={"owner": "spare", "scopes": ["admin"]}).json()["secret"]
    revoking = fuzz(farm, served, spare, checks=checks, paths=("--include-path", REVOKING), **how)
    return {"as_served": as_served, "with_existing_ids": existing, "revoking": revoking}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--examples", type=int, default=100, help="most cases of an operation and a phase")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, services(Path(folder) / "farm", **SETTINGS) as farm:
        how = {"examples": given.examples, "seed": given.seed, "phases": "coverage,fuzzing,stateful"}
        found = passes(farm, farm.tokens["admin"], **how)
    found = {"schemathesis": version("schemathesis"), **how, "checks": CHECKS, **found}
    given.out.write_text(json.dumps(found, indent=1) + "\n")
    print(given.out.read_text())
    return int(any(found[run]["failures"] for run in RUNS))


if __name__ == "__main__":
    sys.exit(main())
