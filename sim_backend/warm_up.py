"""``python -m sim_backend.warm_up``: compile everything that robots need, so that many that start at once need not each do so."""

import sys

import numpy as np

from sim_backend.driver.driver import Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.driver.tracker import Tracker
from sim_backend.effects.ranges import load_ranges
from sim_backend.trifinger import constants as c


def main() -> int:
    """Drive and track one robot that has effects, for two steps."""
    physics = load_ranges("real").draw(np.random.default_rng(0), 1)
    driver, tracker = SimulatedDriver(physics=physics), Tracker(physics=physics)
    position, quat = np.array([[0.0, 0.0, c.CUBE_REST_HEIGHT_M]]), np.array([[1.0, 0.0, 0.0, 0.0]])
    driver.reset(Start(c.START_JOINT_POSITION_RAD[None], position, quat, noise_seed=np.zeros(1)))
    tracker.reset(driver.measure(), np.zeros(1))
    tracker.capture(driver.advance_torques(np.zeros((1, 2, 9))))
    tracker.reading(2)
    return 0


if __name__ == "__main__":
    sys.exit(main())
