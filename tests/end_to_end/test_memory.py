"""A recurrent policy through a whole farm: its memory is kept within a trial and gone in the next, as the logs show.

sb3-contrib trains it for a few steps and says what it should have done; the archive goes to the farm as it was saved.
"""

import numpy as np
import pytest

from api_schemas.policy import PolicyManifest, canonical_json
from api_schemas.trial_log_reader import read_log
from tests.end_to_end.farm import Farm
from tests.unit.client_cli.toy_env import ToyEnv

MANIFEST = PolicyManifest(
    observation=("joint_position_rad", "joint_velocity_rad_s", "goal_fingertip_position_world_m", "previous_action"),
    output_scaling={"clip": 1.0, "scale": 0.1},
)
TRIALS = 3


@pytest.fixture(scope="module")
def trained():
    contrib = pytest.importorskip("sb3_contrib", reason="sb3-contrib is not installed: its RecurrentPPO cannot be trained")
    settings = {"n_steps": 32, "batch_size": 32, "n_epochs": 4, "learning_rate": 0.02}
    layers = {"lstm_hidden_size": 16, "net_arch": [16]}
    model = contrib.RecurrentPPO(
        "MlpLstmPolicy", ToyEnv(MANIFEST.observation_size), policy_kwargs=layers, seed=3, device="cpu", **settings
    )
    return model.learn(128)


@pytest.fixture(scope="module")
def logs(trained, tmp_path_factory):
    """The logs of trials that one robot ran one after the other, in their order."""
    folder = tmp_path_factory.mktemp("memory")
    trained.save(folder / "recurrent.zip")
    (folder / "recurrent.json").write_text(canonical_json(MANIFEST))
    with Farm(folder / "farm", robots=1) as farm:
        job = farm.submit(folder / "recurrent.zip", task="reach", trials=TRIALS, seed=4)
        assert farm.report(job)["platform_faults"] == 0
        farm.run("fetch", job, "--to", str(folder / "logs"))
    return [read_log(path) for path in sorted((folder / "logs").glob("*.mcap"))]


def predicted(model, observations, state=None):
    """What the library's own policy does in a trial that begins with a memory, and the one that it ends with."""
    actions, begins = [], np.array([state is None])
    for observation in observations:
        action, state = model.predict(observation, state, begins, deterministic=True)
        actions.append(np.clip(action, -1, 1) * 0.1)
        begins = np.array([False])
    return np.stack(actions), state


def test_each_trial_begins_with_no_memory_and_keeps_its_own(trained, logs):
    assert len(logs) == TRIALS
    left_over = None
    for log in logs:
        wanted, memory = predicted(trained, log.observation)
        difference = float(np.abs(log.action - wanted).max())
        print(f"largest difference in {len(wanted)} actions of a trial: {difference:.2g} N m")
        assert len(wanted) == 250
        assert difference <= 1e-5
        forgetful = np.concatenate([predicted(trained, row[None])[0] for row in log.observation])
        assert np.abs(forgetful - wanted).max() > 1e-3, "without memory it would have acted otherwise"
        if left_over is not None:
            assert np.abs(predicted(trained, log.observation, left_over)[0] - wanted).max() > 1e-3, "nor with that of before"
        left_over = memory
