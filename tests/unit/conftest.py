"""A short real trial that several tests look at."""

from pathlib import Path

import pytest

from api_schemas.policy import LAYOUTS
from api_schemas.robot import Lease
from tests.graphs import linear


def lease(*, task: str = "push", seed: int = 5, ordinal: int = 0, layout: str = "rrc2022-push", job_id: str = "jtest") -> Lease:
    """A lease as the dispatcher would offer it."""
    return Lease(
        trial_id=f"{job_id}-{ordinal:03d}",
        job_id=job_id,
        ordinal=ordinal,
        fence=1,
        robot="robot-0",
        policy="0" * 64,
        manifest=LAYOUTS[layout],
        graph_sha256="0" * 64,
        task=task,
        seed=seed,
    )


@pytest.fixture(scope="session")
def short_log(tmp_path_factory) -> Path:
    """The log of a real trial of one simulated second."""
    import dataclasses

    from robot_farm import trial
    from robot_farm.policy.jail import JailedPolicy
    from sim_backend.driver.simulated import SimulatedDriver

    folder = tmp_path_factory.mktemp("short-log")
    path = folder / "trial.mcap"
    tasks = trial.TASKS
    trial.TASKS = {"push": dataclasses.replace(tasks["push"], duration_s=1.0)}
    try:
        with JailedPolicy("linear", linear(folder / "linear.onnx")) as policy:
            trial.run_trial(lease(), policy, SimulatedDriver(), trial.log_channels(), path, stop_reason=lambda: None)
    finally:
        trial.TASKS = tasks
    return path
