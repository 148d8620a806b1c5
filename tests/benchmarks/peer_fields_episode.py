"""What the published environment shows of a few control periods, for ``peer_fields``; runs in the environment of ``peer``.

    python peer_fields_episode.py TASK SEED STEPS OUT.npz [TORQUE TORQUE TORQUE]

Random torques act, so that every field moves, or the given ones on the joints of each finger, so that it presses. Writes the flat
observations, and for every millisecond what our side is given: reported joint states and torques, and the cube's true pose.
"""

import importlib
import random
import sys

import numpy as np

DIFFICULTY = {"push": 1, "lift": 4}
ACTION_DELAY_MS = {"push": 10, "lift": 2}


def main() -> None:
    """The command; see the module's docstring."""
    task, seed, steps, out = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), sys.argv[4]
    simulation = importlib.import_module("trifinger_rl_datasets.sim_env").SimTriFingerCubeEnv
    spaces = importlib.import_module("gymnasium").spaces
    random.seed(seed)
    np.random.seed(seed)  # the simulation draws its cubes and goals by it
    env = simulation(
        episode_length=steps + 10, difficulty=DIFFICULTY[task], obs_action_delay=ACTION_DELAY_MS[task], real_time=False
    )
    poses = []
    append = env._append_desired_action

    def watched(action):
        cube = env.platform.cube.get_state()
        poses.append(np.concatenate([np.asarray(cube[0], float), np.asarray(cube[1], float)]))
        return append(action)

    env._append_desired_action = watched
    seen, _ = env.reset()
    rng = np.random.default_rng(seed)
    flat, times, goals, sent = [], [], [], []
    torque = np.zeros(9)
    for _ in range(steps):
        torque = np.clip(0.8 * torque + rng.normal(scale=0.12, size=9), -0.39, 0.39).astype(np.float32)
        torque = np.tile(np.array(sys.argv[5:8], np.float32), 3) if sys.argv[5:] else torque
        sent.append(torque)
        seen, _, _, _, info = env.step(torque)
        flat.append(spaces.flatten(env.observation_space, seen))
        times.append(info["time_index"])
        goal = info["desired_goal"]
        goals.append(np.concatenate([goal["object_position"], goal["object_orientation"]]))
    contents = {
        "flat": np.stack(flat),
        "times": np.array(times),
        "goals": np.stack(goals),
        "poses": np.stack(poses),
        "sent": np.stack(sent),
    }
    np.savez(out, allow_pickle=False, **contents)


if __name__ == "__main__":
    main()
