"""Success predicted and measured: the figures of known outcomes, what counts as measured, and a prediction for real."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from api_schemas.policy import LAYOUTS
from sim_backend.effects.physics import Physics
from sim_backend.evaluation import evaluate
from sim_backend.reality_gap.success.gain import Measured, predicted, read_measured, success_gain
from sim_backend.reality_gap.success.policy_file import load_policy
from sim_backend.tasks import TASKS
from sim_backend.trifinger import constants as c

RNG = np.random.default_rng


def outcomes(rate: float, n: int, seed: int) -> np.ndarray:
    return RNG(seed).random(n) < rate


def test_a_gain_that_is_there():
    measured = outcomes(0.6, 400, 1)
    gain = success_gain(np.ones(400, bool), outcomes(0.62, 400, 2), measured, RNG(0))
    nominal, extended, truth = gain.rows
    assert [row.label for row in gain.rows] == ["nominal", "extended", "measured"]
    assert gain.gap_before == pytest.approx(1.0 - measured.mean())
    assert gain.gap_after == pytest.approx(extended.rate - truth.rate)
    assert gain.closed_interval_95[0] > 0.2
    assert gain.summary.startswith(
        f"success simulated 100% -> {extended.rate:.0%}, measured {truth.rate:.0%} (400 trials): gap +"
    )
    assert gain.summary.endswith("the extended model predicts better")
    assert nominal.interval_80[1] == 1.0
    low, high = truth.interval_80
    z = norm.ppf(0.9)
    assert (high - low) / 2 == pytest.approx(z * (0.24 / 400) ** 0.5, rel=0.03)


def test_no_gain_is_reported_as_such():
    predictions, measured = outcomes(0.9, 200, 1), outcomes(0.6, 200, 2)
    gain = success_gain(predictions, predictions, measured, RNG(0))
    assert (gain.closed, gain.closed_interval_95) == (0.0, (0.0, 0.0))
    assert gain.summary.endswith("no gain")
    little = success_gain(outcomes(0.7, 200, 3), outcomes(0.7, 200, 4), outcomes(0.7, 200, 5), RNG(0))
    assert "no difference that 200 trials can tell" in little.summary


def test_a_worse_model_is_called_worse():
    gain = success_gain(outcomes(0.6, 300, 1), np.zeros(300, bool), outcomes(0.6, 300, 2), RNG(0))
    assert gain.closed < -0.4
    assert gain.summary.endswith("the extended model predicts worse")


def test_intervals_cover_the_gap_between_two_rates():
    covered = 0
    for case in range(100):
        nominal, measured = outcomes(0.9, 150, 2 * case), outcomes(0.65, 150, 2 * case + 1)
        low, high = success_gain(nominal, nominal, measured, RNG(0), resamples=300).gap_before_interval_95
        covered += low <= 0.25 <= high
    assert covered >= 88  # 95 expected, three standard deviations


def test_pairs_narrow_the_interval():
    measured = outcomes(0.5, 400, 1)
    paired = success_gain(measured ^ (RNG(7).random(400) < 0.05), measured, measured, RNG(0))
    apart = success_gain(outcomes(0.5, 400, 8), outcomes(0.5, 400, 9), measured, RNG(0))
    assert np.diff(paired.gap_before_interval_95)[0] < 0.5 * np.diff(apart.gap_before_interval_95)[0]
    assert paired.agreement_after == 1.0


def test_the_section_of_a_study_is_plain():
    physics = Physics.of(1, {"coulomb_friction.torque_nm": 0.02})
    gain = success_gain([True, False], [True, True], [True, False], RNG(0), physics=physics)
    section = json.loads(json.dumps(gain.document()))
    assert section["trials"] == 2
    assert section["rows"][2] == {"label": "measured", "rate": 0.5, "interval_80": pytest.approx([0.16425, 0.83575], abs=1e-4)}
    assert {"gap_before", "gap_after"} <= set(section)
    assert any("no effect of contact or tracking" in note for note in section["notes"])
    with_contact = physics.changed({"table_friction.coefficient": 0.5, "tracking_noise.position_m": 0.002})
    assert len(success_gain([True], [True], [True], RNG(0), physics=with_contact).notes) == 1


@pytest.mark.parametrize("lengths", [(2, 2, 3), (0, 0, 0)])
def test_outcomes_of_other_goals_are_refused(lengths):
    with pytest.raises(ValueError, match="must be of the same goals"):
        success_gain(np.ones(lengths[0]), np.ones(lengths[1]), np.ones(lengths[2]), RNG(0))


def report(tmp_path, rows):
    def outcome(kind, fault):
        return {"kind": kind, "fault": fault, "reason": "r"}

    trials = [
        {"trial": n, "trial_id": f"j-{n}", "robot": robot, "seed": 2**62 + n, "attempts": 1, "outcome": outcome(kind, fault)}
        | {"departure": None, "log_sha256": None}
        for n, (robot, kind, fault) in enumerate(rows)
    ]
    share = {"trials": 2, "successes": 1, "success_rate": 0.5, "interval_80": [0, 1], "platform_faults": 0}
    document = {
        **{"format": "trifarm-report/1", "job_id": "jx", "task": "push", "policy": "f" * 64, "policy_name": "p", "seed": 1},
        **{"trials": len(rows), "successes": 1},
        **{"object": "cube", "object_scale": 1.1, "success_rate": 0.5, "interval_80": [0, 1], "interval_95": [0, 1]},
        **{"success_ever": 1, "mean_success_fraction": None, "mean_return": None, "policy_faults": 1, "platform_faults": 1},
        **{"attempts": 5, "timing": None, "per_robot": [{"robot": robot, **share} for robot in ("robot-0", "robot-1")]},
        **{"per_trial": trials, "platform_fault_attempts": [], "created_at": "x", "started_at": None, "ended_at": "y"},
        **{"versions": {}},
    }
    (tmp_path / "report.json").write_text(json.dumps(document))
    return tmp_path


ROWS = [
    ("robot-0", "succeeded", "none"),
    ("robot-0", "failed", "none"),
    ("robot-0", "platform_error", "platform"),
    ("robot-0", "nonfinite_action", "policy"),
    ("robot-1", "succeeded", "none"),
    ("robot-0", "cancelled", "none"),
]


def test_what_a_fetched_job_measured(tmp_path):
    of_one, of_all = (read_measured(report(tmp_path, ROWS), robot) for robot in ("robot-0", None))
    assert of_one.seeds == (2**62, 2**62 + 1, 2**62 + 3)
    assert of_one.success.tolist() == [True, False, False]
    assert of_all.success.tolist() == [True, False, False, True]
    assert (of_one.task, of_one.shape.name) == ("push", "cube")


def test_folders_that_measured_nothing(tmp_path):
    with pytest.raises(ValueError, match=r"no report\.json; bring a job's"):
        read_measured(tmp_path)
    with pytest.raises(ValueError, match="no counted trial of robot-7; its robots are robot-0, robot-1"):
        read_measured(report(tmp_path, ROWS), "robot-7")
    (tmp_path / "report.json").write_text("{}")
    with pytest.raises(ValueError, match=r"report\.json is not the report of a job"):
        read_measured(tmp_path)


MANIFEST = LAYOUTS["rrc2022-push"]
WEIGHTS = RNG(3).normal(scale=0.1, size=(MANIFEST.observation_size, 9))


def act(observation: np.ndarray) -> np.ndarray:
    return np.clip(observation.astype(float) @ WEIGHTS, -1, 1) * c.MAX_TORQUE_NM


def test_a_prediction_tries_the_measured_goals(monkeypatch):
    short = replace(TASKS["reach"], duration_s=0.1)
    monkeypatch.setattr("sim_backend.reality_gap.success.gain.TASKS", {"reach": short})
    monkeypatch.setattr("sim_backend.reality_gap.success.gain.BATCH", 2)
    measured, done = Measured("reach", (4, 5, 2**62), np.zeros(3, bool)), []
    found = predicted(act, MANIFEST, measured, Physics.of(1, {"joint_noise.position_rad": 0.01}), progress=done.append)
    assert found.shape == (3,) and found.dtype == bool
    assert done == [2, 3]
    plain = evaluate(act, MANIFEST, short, measured.seeds)
    assert (predicted(act, MANIFEST, measured, Physics.nominal()) == plain.success).all()


def test_a_policy_from_its_file(tmp_path):
    from safetensors.numpy import save_file

    size = MANIFEST.observation_size
    weights = {"layer0.weight": RNG(0).normal(size=(9, size)).astype(np.float32), "layer0.bias": np.zeros(9, np.float32)}
    weights |= {"observation_low": -np.ones(size, np.float32), "observation_high": np.ones(size, np.float32)}
    weights |= {"torque_limit_nm": np.full(9, 0.36, np.float32)}
    save_file(weights, tmp_path / "policy.safetensors")
    run, manifest = load_policy(tmp_path / "policy.safetensors", "rrc2022-push")
    observation = RNG(1).uniform(-1, 1, (3, size)).astype(np.float32)
    expected = np.clip(observation @ weights["layer0.weight"].T, -1, 1) * 0.36
    assert manifest == MANIFEST
    assert run(observation) == pytest.approx(expected, abs=1e-5)
    with pytest.raises(ValueError, match="is no policy for this manifest"):
        load_policy(tmp_path / "policy.safetensors", "rrc2022-lift")
    with pytest.raises(ValueError, match="no manifest 'mine'; choose from rrc2022-push"):
        load_policy(tmp_path / "policy.safetensors", "mine")
    with pytest.raises(ValueError, match="no policy file"):
        load_policy(tmp_path / "none.onnx", "rrc2022-push")
