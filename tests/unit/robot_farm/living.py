"""A robot with a life of its own for the tests: trials of a second with a small policy, log and truth beside each other."""

import dataclasses
from pathlib import Path

from api_schemas.robot import Lease
from api_schemas.trial import Outcome
from robot_farm.faults import parse_fault
from robot_farm.hidden_physics import HiddenPhysics
from robot_farm.life import Life
from robot_farm.policy.jail import JailedPolicy
from robot_farm.settings import Reset
from robot_farm.trial import measured_channels, run_trial
from robot_farm.truth import TruthFile, truth_channels
from sim_backend.tasks import TASKS

SHORT_TASKS = {name: dataclasses.replace(task, duration_s=1.0) for name, task in TASKS.items()}


class Living:
    """One robot, its channels and the folder of its files."""

    def __init__(self, folder: Path, *faults: str, physics: str = "real", reset: Reset = Reset.SWEEP, **more) -> None:
        self.folder = folder
        hidden = HiddenPhysics(b"secret of the tests", "robot-0", physics)
        self.life = Life("robot-0", hidden.of_trial, reset, tuple(parse_fault(f"robot-0:{fault}") for fault in faults), **more)
        self.channels, self.truth_channels = measured_channels(), truth_channels()

    def log(self, lease: Lease) -> Path:
        return self.folder / f"{lease.trial_id}.mcap"

    def truth(self, lease: Lease) -> Path:
        return self.folder / f"{lease.trial_id}.truth.mcap"

    def prepare(self, lease: Lease):
        return self.life.prepare(lease, TruthFile(self.truth(lease), self.truth_channels), lambda: None)

    def run(self, lease: Lease, policy: JailedPolicy | None) -> Outcome:
        prepared = self.prepare(lease)
        return run_trial(
            lease,
            policy,
            self.life.driver,
            self.channels,
            self.log(lease),
            stop_reason=lambda: None,
            physics="real",
            prepared=prepared,
        )
