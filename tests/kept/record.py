"""Makes a kept version's fixtures: ``python -m tests.kept.record --checkout CLONE --to tests/kept/v0_1_0``.

The clone's code does everything that is kept: its farms run the jobs, its command line fetches, and its schemas write the
manifests. ``README.md`` in a version's folder says what was changed in the clone before.
"""

import argparse
import json
import subprocess
import sys
import tarfile
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import safetensors.numpy

from tests.benchmarks.same_bits import farm
from tests.hostile.valid import MANIFEST, onnx_file, sb3_file
from tests.integration.farm_process import PATIENCE_S, small_policy, until

REFERENCE = Path("sim_backend/training/reference_policies")
SUCCEEDS = 912
"""The seed of a job whose third trial begins within the tolerance of its goal."""
HOOK = "https://hooks.example.invalid/trifarm"
MANIFESTS = """
import json, sys
from api_schemas.policy import LAYOUTS, PolicyManifest, canonical_json, policy_digest
given = json.load(sys.stdin)
made = {f"layout-{name}": manifest for name, manifest in LAYOUTS.items()}
made |= {name: PolicyManifest.model_validate(manifest) for name, manifest in given.items()}
print(json.dumps({name: [canonical_json(manifest), policy_digest("0" * 64, manifest)] for name, manifest in made.items()}))
"""
ARRAYS = """
import dataclasses, hashlib, json, pathlib, sys
import numpy as np
from api_schemas.trial_log_reader import read_log, read_truth
def digests(log):
    values = {field.name: getattr(log, field.name) for field in dataclasses.fields(log)}
    arrays = {name: value for name, value in values.items() if isinstance(value, np.ndarray)}
    return {name: [list(value.shape), hashlib.sha256(value.tobytes()).hexdigest()] for name, value in arrays.items()}
root = pathlib.Path(sys.argv[1])
readers = {path: read_truth if path.name.endswith(".truth.mcap") else read_log for path in sorted(root.rglob("*.mcap"))}
print(json.dumps({str(path.relative_to(root)): digests(read(path)) for path, read in readers.items()}))
"""
LEFT_BEHIND = ("serve.lock", "up.lock", "robots", "logs", "incoming")
"""Of a farm's folder: locks, logs of processes, what robots fetched and half an upload."""


def policies(folder: Path) -> dict[str, Path]:
    """Small policies of each form that the server takes, with their manifests beside them, by name."""
    folder.mkdir()
    plain = small_policy()[1]
    rng, size = np.random.default_rng(7), plain.observation_size
    shapes = {"weight_ih_l0": (24, size), "weight_hh_l0": (24, 8), "bias_ih_l0": (24,), "bias_hh_l0": (24,)}
    memory = {f"recurrent.{name}": rng.normal(0, 0.1, shape).astype(np.float32) for name, shape in shapes.items()}
    ends = {"layer0.weight": (9, 8), "layer0.bias": (9,)}
    tensors = {name: rng.normal(0, 0.1, shape).astype(np.float32) for name, shape in ends.items()}
    tensors |= memory | {"torque_limit_nm": np.full(9, 0.397, np.float32)}
    made = {
        "small.safetensors": (small_policy()[0], plain.model_copy(update={"name": "small"})),
        "recurrent.safetensors": (
            safetensors.numpy.save(tensors),
            plain.model_validate(plain.model_dump() | {"name": "recurrent", "recurrent": "gru"}),
        ),
        "network.onnx": (onnx_file(), MANIFEST.model_copy(update={"name": "network"})),
        "archive.zip": (sb3_file(), MANIFEST.model_copy(update={"name": "archive"})),
    }
    paths = {}
    for name, (weights, manifest) in made.items():
        path = folder / name
        path.write_bytes(weights)
        path.with_suffix(".json").write_text(manifest.model_dump_json())
        paths[path.stem] = path
    ladder = folder / "ladder"
    ladder.mkdir()
    for number in (100, 200):
        (ladder / f"small_{number}.safetensors").write_bytes(small_policy(seed=number)[0])
        (ladder / f"small_{number}.json").write_text(plain.model_copy(update={"name": f"small-{number}"}).model_dump_json())
    return paths | {"ladder": ladder}


def manifests(python: str, checkout: Path, made: dict[str, Path], to: Path) -> None:
    """Every ready-made layout and manifests that use every field, as the clone spells them, with their digests."""
    given = {name: json.loads(path.with_suffix(".json").read_text()) for name, path in made.items() if path.is_file()}
    for path in sorted((checkout / REFERENCE).glob("*.safetensors")):
        given[f"reference-{path.stem}"] = json.loads(path.with_suffix(".json").read_text())
    plain = given["small"]
    state = {"input": "h", "output": "h_next", "shape": [1, 1, 8]}
    given |= {
        "states": plain | {"name": "states", "states": [state]},
        "frame-stack": plain | {"name": "frame-stack", "frame_stack": {"count": 3, "fill": "zeros"}, "head": "gaussian"},
        "bins": plain | {"name": "bins", "head": "bins", "bins": 11, "action_kind": "joint_position_delta"},
        "scaled": plain
        | {
            "name": "scaled",
            "rate_hz": 25,
            "action_kind": "joint_position",
            "input_scaling": {"mean": [0.5] * 54, "variance": [2.0] * 54, "clip": 10.0},
            "output_scaling": {"squash": "tanh", "scale": [0.1] * 9, "offset": [0.0, 0.9, -1.7] * 3},
        },
    }
    (to / "manifests").mkdir()
    digests = {}
    for name, (spelled, digest) in _said(python, checkout, MANIFESTS, json.dumps(given)).items():
        (to / "manifests" / f"{name}.json").write_text(json.dumps(json.loads(spelled), indent=1) + "\n")
        digests[name] = digest
    (to / "digests.json").write_text(json.dumps(digests, indent=1) + "\n")


def _said(python: str, checkout: Path, program: str, given: str, *arguments: object) -> Any:
    """What a few lines that import the clone's code print, from JSON."""
    command = [python, "-P", "-c", program, *map(str, arguments)]
    environment = {"PYTHONPATH": str(checkout)}
    ran = subprocess.run(command, check=True, input=given, env=environment, stdout=subprocess.PIPE, text=True)
    return json.loads(ran.stdout)


class Trifarm:
    """The clone's command line on its farm."""

    def __init__(self, python: str, environment: dict[str, str], folder: Path) -> None:
        self.python, self.environment, self.folder = python, environment, folder

    def __call__(self, *arguments: object) -> str:
        command = [self.python, "-m", "client_cli", *map(str, arguments)]
        done = subprocess.run(command, cwd=self.folder, env=self.environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{command}: {done.returncode}\n{done.stdout}\n{done.stderr}"
        return done.stdout

    def submit(self, *arguments: object) -> str:
        return self("submit", *arguments).split()[0]

    def fetch(self, job_id: str) -> str:
        self("fetch", job_id, "--to", self.folder / "fetched" / job_id, "--truth")
        return job_id


def nominal(trifarm: Trifarm, made: dict[str, Path]) -> dict[str, str]:
    """Robots that are all alike: a job of three trials with a webhook, a ladder, a policy that is only uploaded."""
    push = trifarm.submit(made["small"], "--task", "push", "--trials", 3, "--seed", SUCCEEDS, "--webhook", HOOK, "--wait")
    ladder = trifarm.submit(made["ladder"], "--task", "reach", "--trials", 1, "--seed", 13, "--wait")
    trifarm("report", push, "--html", trifarm.folder / "report.html")
    trifarm("token", "create", "--owner", "alice", "--scope", "submit")
    token = json.loads(trifarm("token", "create", "--owner", "bob", "--scope", "submit", "--json"))
    trifarm("token", "revoke", token["token_id"])
    return {"push": trifarm.fetch(push), "ladder": ladder}


def real(trifarm: Trifarm, made: dict[str, Path]) -> dict[str, str]:
    """Robots that differ: jobs of a recurrent network and an archive, an identification, and a job that is cancelled."""
    push = trifarm.submit(made["recurrent"], "--task", "push", "--trials", 1, "--seed", 855, "--wait")
    reach = trifarm.submit(made["archive"], "--task", "reach", "--trials", 1, "--seed", 11, "--wait")
    flags = ["--robot", "robot-0", "--excitation", "oscillations", "--seed", 3, "--wait"]
    identification = trifarm("identify", *flags).split()[0]
    for robot in ("robot-0", "robot-1"):
        trifarm("robots", "drain", robot)
    cancelled = trifarm.submit(made["network"], "--task", "lift", "--trials", 5, "--seed", 14, "--priority", "low")
    trifarm("cancel", cancelled)
    until(lambda: "cancelled" in trifarm("jobs"), PATIENCE_S, "the job to be cancelled")
    kept = {
        name: trifarm.fetch(job_id) for name, job_id in (("push", push), ("reach", reach), ("identification", identification))
    }
    return kept | {"cancelled": cancelled}


def record(checkout: Path, python: str, to: Path) -> None:
    to.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        made = policies(folder / "policies")
        manifests(python, checkout, made, to)
        jobs, arrays = {}, {}
        for physics, work in (("nominal", nominal), ("real", real)):
            options = ["--robots", "2", "--physics", physics, "--farm-seed", "77"]
            home = folder / physics
            with farm(checkout, python, home, options, TRIFARM_WEBHOOKS="true") as environment:
                jobs[physics] = work(Trifarm(python, environment, home), made)
            arrays[physics] = _said(python, checkout, ARRAYS, "", home / "fetched")
            with tarfile.open(to / f"{physics}.tar.xz", "w:xz") as archive:
                for part in ("farm", "fetched", "report.html", "farm-keys.json"):
                    if (home / part).exists():
                        archive.add(home / part, part, filter=_kept)
        (to / "arrays.json").write_text(json.dumps(arrays, indent=1) + "\n")
        (to / "jobs.json").write_text(json.dumps(jobs, indent=1) + "\n")


def _kept(member: tarfile.TarInfo) -> tarfile.TarInfo | None:
    if Path(member.name).name in LEFT_BEHIND:
        return None
    member.uid = member.gid = 0
    member.uname = member.gname = ""
    return member


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--checkout", type=Path, required=True, metavar="CLONE")
    parser.add_argument("--python", default=sys.executable, help="the interpreter, with the libraries that the clone needs")
    parser.add_argument("--to", type=Path, required=True, metavar="FOLDER")
    asked = parser.parse_args()
    record(asked.checkout.resolve(), asked.python, asked.to.resolve())


if __name__ == "__main__":
    main()
