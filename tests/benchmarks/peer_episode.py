"""An episode of a published expert in the published simulation, for ``peer``; runs in the environment that ``peer`` makes.

    python peer_episode.py TASK WEIGHTS.npz SEED CORE STEPS

Prints one line of JSON: the processor's and the clock's seconds of the episode without its reset, the simulated seconds, and
whether the goal was reached at its end. The network is run by numpy, one observation at a time, and counts.
"""

import importlib
import json
import os
import random
import sys
import time

import numpy as np

DIFFICULTY = {"push": 1, "lift": 4}
ACTION_DELAY_MS = {"push": 10, "lift": 2}
STEP_S = 0.02


def action_nm(net: dict[str, np.ndarray], observation: np.ndarray) -> np.ndarray:
    """The expert's torques, shape (9,), in N m; the formula stands beside the weights."""
    scaled = 2 * (observation - net["observation_low"]) / (net["observation_high"] - net["observation_low"]) - 1
    y = np.clip((scaled - net["running_mean"]) / np.sqrt(net["running_var"] + 1e-5), -5, 5)
    layers = sum(name.endswith(".weight") for name in net)
    for layer in range(layers):
        y = net[f"layer{layer}.weight"] @ y + net[f"layer{layer}.bias"]
        if layer < layers - 1:
            y = np.where(y > 0, y, np.expm1(np.minimum(y, 0)))
    return np.clip(y, -1, 1) * net["torque_limit_nm"]


def observed(task: str, seen: dict) -> np.ndarray:
    """What the expert sees, in its order."""
    robot, goal = seen["robot_observation"], seen["desired_goal"]
    wanted = goal["object_position"] if task == "push" else goal["object_keypoints"].ravel()
    keypoints = seen["camera_observation"]["object_keypoints"].ravel()
    return np.concatenate([robot["position"], robot["velocity"], keypoints, wanted, seen["action"]])


def main() -> None:
    """The command; see the module's docstring."""
    task, weights, seed, core, steps = sys.argv[1], sys.argv[2], *map(int, sys.argv[3:])
    os.sched_setaffinity(0, {core})
    simulation = importlib.import_module("trifinger_rl_datasets.sim_env").SimTriFingerCubeEnv
    random.seed(seed)
    np.random.seed(seed)  # the simulation draws its cubes and goals by it
    settings = {"difficulty": DIFFICULTY[task], "obs_action_delay": ACTION_DELAY_MS[task], "real_time": False}
    env = simulation(episode_length=steps, **settings)
    with np.load(weights) as file:
        net = {name: file[name].astype(np.float32) for name in file.files}
    seen, info = env.reset()
    cpu_s, wall_s = time.process_time(), time.perf_counter()
    low, high = env.action_space.low, env.action_space.high
    for _ in range(steps):
        seen, _, _, _, info = env.step(np.clip(action_nm(net, observed(task, seen)), low, high))
    found = {"cpu_s": time.process_time() - cpu_s, "wall_s": time.perf_counter() - wall_s, "simulated_s": STEP_S * steps}
    print(json.dumps(found | {"success": bool(info["has_achieved"])}))


if __name__ == "__main__":
    main()
