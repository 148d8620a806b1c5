"""Records what robots see, for the dry run of uploads: ``python -m tests.benchmarks.record_observations --out FILE``.

With ``--images FILE`` it renders the few scenes that policies which see are shown, instead.

The beginning of one trial of each of three tasks in the farm's simulation, with robots whose physics is drawn from the ranges
``real`` and the reference policy acting (it was trained to push; what matters is what a robot sees, not whether it succeeds).
"""

import argparse
import hashlib
from pathlib import Path

import numpy as np
import safetensors.numpy

from api_schemas.policy import PolicyManifest
from services.policies.recorded import FIELDS, IMAGES, RECORDING
from sim_backend.effects.ranges import load_ranges
from sim_backend.evaluation import begin_trials
from sim_backend.reality_gap.success.policy_file import load_policy
from sim_backend.tasks import TASKS

ROOT = Path(__file__).parents[2]
REFERENCE = ROOT / "sim_backend/training/reference_policies/push.safetensors"
TASK_NAMES = ("lift", "push", "reach")
STEPS, SEED = 50, 20261121
SCENES, IMAGE_EDGE_PX = 4, 54
COMMAND = "python -m tests.benchmarks.record_observations"


def record(task, act, reference):
    """All fields in the first second of a trial, by name, each of shape (STEPS, size)."""
    seen = PolicyManifest(
        observation=(*reference.observation, *FIELDS), rate_hz=reference.rate_hz, action_delay_s=reference.action_delay_s
    )
    rng = np.random.default_rng([SEED, TASK_NAMES.index(task)])
    ranges = load_ranges("real")
    physics = ranges.draw_episode(rng, ranges.draw(rng, 1))
    episode, _ = begin_trials(seen, TASKS[task], [int(rng.integers(2**31))], physics=physics, threads=1)
    rows = []
    for _ in range(STEPS):
        observation = episode.observe().astype(np.float32)
        rows.append(observation[0, reference.observation_size :])
        episode.advance(np.asarray(act(observation[:, : reference.observation_size]), float))
    sizes = [PolicyManifest(observation=(name,)).observation_size for name in FIELDS]
    return dict(zip(FIELDS, np.split(np.stack(rows), np.cumsum(sizes)[:-1], axis=1), strict=True))


def recording():
    """The recorded tensors and what they were made with."""
    act, reference = load_policy(REFERENCE, str(REFERENCE.with_suffix(".json")))
    tensors = {}
    for task in TASK_NAMES:
        act.begin(1)  # pyrefly: ignore[missing-attribute] - the reference has a memory
        tensors |= {f"{task}/{name}": np.ascontiguousarray(rows) for name, rows in record(task, act, reference).items()}
    made = {
        "format": "trifarm-recorded-observations/1",
        "command": COMMAND,
        "policy": f"reference push policy, weights {hashlib.sha256(REFERENCE.read_bytes()).hexdigest()}",
        "physics": "one robot for each task, drawn from the ranges real",
        "seed": str(SEED),
        "rate_hz": str(reference.rate_hz),
    }
    return tensors, made


def images_of_scenes():
    """The tensor of images, shape (SCENES, 3, IMAGE_EDGE_PX, IMAGE_EDGE_PX, 3), uint8, and what it was made with."""
    from robot_farm.eyes import smaller
    from sim_backend.vision.cameras import Cameras
    from sim_backend.vision.scenes import drawn_scene

    rng = np.random.default_rng(SEED)
    physics = load_ranges("real-images").draw(rng, 1)
    with Cameras(physics) as cameras:
        scenes = [drawn_scene(rng) for _ in range(SCENES)]
        taken = [cameras.take(each.joint_position_rad, each.position_world_m, each.quat_wxyz, seed=SEED) for each in scenes]
    made = {
        "format": "trifarm-recorded-images/1",
        "command": f"{COMMAND} --images FILE",
        "physics": "one robot drawn from the ranges real-images",
        "seed": str(SEED),
    }
    return {IMAGES: np.stack([smaller(each, IMAGE_EDGE_PX) for each in taken])}, made


def main():
    """Writes the file."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=RECORDING)
    parser.add_argument("--images", type=Path, help="write images of scenes to this file instead")
    given = parser.parse_args()
    if given.images is not None:
        given.images.write_bytes(safetensors.numpy.save(*images_of_scenes()))
        print(f"{given.images.name}: {SCENES} scenes, {given.images.stat().st_size} bytes")
        return
    out = given.out
    tensors, made = recording()
    out.write_bytes(safetensors.numpy.save(tensors, made))
    print(f"{out.name}: {len(TASK_NAMES)} trials of {STEPS} observations, {out.stat().st_size} bytes")


if __name__ == "__main__":
    main()
