"""A trial from lease to outcome, with a real policy process and a real log."""

import dataclasses
import json
from collections import Counter
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from foxglove import messages as fm
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

from api_schemas.goal import OwnGoal
from api_schemas.trial import Fault, OutcomeKind
from robot_farm import trial
from robot_farm.policy.jail import JailedPolicy
from robot_farm.trial import Progress, TrialStoppedError, log_channels, run_trial
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.evidence import Witness, why_of_log
from sim_backend.tasks import TASKS
from sim_backend.tasks.task import Goal
from sim_backend.trifinger.objects import CUBE, shape_of
from tests.graphs import linear, long_error
from tests.unit.conftest import lease
from trial_logs import trial_log
from trial_logs.reader import read_log


@pytest.fixture
def one_second(monkeypatch):
    monkeypatch.setattr(trial, "TASKS", {name: dataclasses.replace(task, duration_s=1.0) for name, task in TASKS.items()})


@pytest.fixture(scope="module")
def policy(tmp_path_factory):
    with JailedPolicy("linear", linear(tmp_path_factory.mktemp("policy") / "linear.onnx")) as policy:
        yield policy


@pytest.mark.usefixtures("one_second")
@pytest.mark.parametrize("task", TASKS)
def test_every_task_runs_and_is_measured(task, policy, tmp_path):
    progress = Progress()
    outcome = run_trial(
        lease(task=task),
        policy,
        SimulatedDriver(),
        log_channels(),
        tmp_path / "t.mcap",
        stop_reason=lambda: None,
        progress=progress,
    )
    assert outcome.kind in (OutcomeKind.SUCCEEDED, OutcomeKind.FAILED)
    assert outcome.fault is Fault.NONE
    assert outcome.measures is not None
    assert outcome.measures.control_steps == 50
    assert (outcome.measures.final_angle_error_rad is not None) == TASKS[task].orientation_counts
    assert progress.simulated_s == 1.0
    log = read_log(tmp_path / "t.mcap")
    assert log.metadata["task"] == task
    assert log.outcome["kind"] == outcome.kind.value
    assert outcome.measures.final_position_error_m != round(outcome.measures.final_position_error_m, 3), "nothing is hidden here"


def test_log_has_every_channel_at_its_rate(short_log):
    with short_log.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        counts = Counter(channel.topic for _, channel, _ in reader.iter_messages())
        attachments = {attachment.name for attachment in reader.iter_attachments()}
    assert counts[trial_log.JOINT_STATES] == counts[trial_log.TORQUE] == 1000
    assert counts[trial_log.CUBE_POSE] == 100
    assert counts[trial_log.TRACKED_POSE] == counts[trial_log.TRACKER] == 11  # one from before the start
    assert counts[trial_log.POLICY] == 50
    assert counts[trial_log.MEASURED_SCENE] == counts[trial_log.TRUE_SCENE] == counts[trial_log.GOAL] == 1
    assert counts[trial_log.MEASURED_TRANSFORMS] == 26
    assert attachments == {"model.xml", "manifest.json"}


def test_same_lease_same_bits_in_a_kept_and_in_a_fresh_process(policy, tmp_path, one_second):
    driver, channels, outcomes = SimulatedDriver(), log_channels(), []
    for index in range(3):
        run_trial(lease(), policy, driver, channels, tmp_path / f"{index}.mcap", stop_reason=lambda: None)
        run_trial(
            lease(seed=99, task="lift"), policy, driver, channels, tmp_path / f"{index}-other.mcap", stop_reason=lambda: None
        )
    with JailedPolicy("fresh", linear(tmp_path / "fresh.onnx")) as fresh:
        outcomes.append(
            run_trial(lease(), fresh, SimulatedDriver(), log_channels(), tmp_path / "fresh.mcap", stop_reason=lambda: None)
        )
    expected = read_log(tmp_path / "fresh.mcap")
    for index in range(3):
        log = read_log(tmp_path / f"{index}.mcap")
        np.testing.assert_array_equal(log.joint_position_rad, expected.joint_position_rad)
        np.testing.assert_array_equal(log.cube_quat_wxyz, expected.cube_quat_wxyz)


@pytest.mark.usefixtures("one_second")
def test_nan_policy_is_a_policy_fault_with_a_complete_log(tmp_path):
    with JailedPolicy("nan", linear(tmp_path / "nan.onnx", bias=float("nan"))) as policy:
        outcome = run_trial(lease(), policy, SimulatedDriver(), log_channels(), tmp_path / "t.mcap", stop_reason=lambda: None)
    assert (outcome.kind, outcome.fault) == (OutcomeKind.NONFINITE_ACTION, Fault.POLICY)
    assert "at 0.000 s" in outcome.reason


@pytest.mark.usefixtures("one_second")
def test_a_stopped_trial_stops_within_one_control_period(policy, tmp_path):
    asked = []

    def stop_reason():
        asked.append(1)
        return "lease lost" if len(asked) > 10 else None

    with pytest.raises(TrialStoppedError, match="lease lost"):
        run_trial(lease(), policy, SimulatedDriver(), log_channels(), tmp_path / "t.mcap", stop_reason=stop_reason)
    with (tmp_path / "t.mcap").open("rb") as stream:
        steps = sum(channel.topic == trial_log.JOINT_STATES for _, channel, _ in make_reader(stream).iter_messages())
    assert steps == 200


@pytest.mark.usefixtures("one_second")
def test_a_long_error_of_the_network_is_cut_and_stays_the_policys_fault(tmp_path):
    with JailedPolicy("long", long_error(tmp_path / "long.onnx")) as policy:
        outcome = run_trial(lease(), policy, SimulatedDriver(), log_channels(), tmp_path / "t.mcap", stop_reason=lambda: None)
    assert (outcome.kind, outcome.fault) == (OutcomeKind.POLICY_ERROR, Fault.POLICY)
    assert len(outcome.reason) > 500


@pytest.mark.usefixtures("one_second")
def test_reach_logs_its_fingertip_goal(policy, tmp_path):
    run_trial(lease(task="reach"), policy, SimulatedDriver(), log_channels(), tmp_path / "t.mcap", stop_reason=lambda: None)
    assert read_log(tmp_path / "t.mcap").goal is None
    with (tmp_path / "t.mcap").open("rb") as stream:
        records = {record.name: record.metadata for record in make_reader(stream).iter_metadata()}
    assert len(json.loads(records["goal"]["fingertip_position_world_m"])) == 9


def test_models_of_other_sizes_are_forgotten():
    for scale in np.linspace(0.6, 1.2, 2 * trial.KEPT_MODELS):
        trial._model_xml(shape_of("cube", float(scale)))
    assert trial._model_xml.cache_info().currsize <= trial.KEPT_MODELS


@pytest.mark.usefixtures("one_second")
def test_a_failed_trial_says_why_and_its_log_says_the_same(policy, tmp_path):
    given = lease(task="push").model_copy(update={"own_goal": OwnGoal(position_m=(0.1, 0.05, 0.0325))})
    outcome = run_trial(given, policy, SimulatedDriver(), log_channels(), tmp_path / "t.mcap", stop_reason=lambda: None)
    log = read_log(tmp_path / "t.mcap")
    why = why_of_log(log)
    assert outcome.kind is OutcomeKind.FAILED and outcome.failure is not None
    assert (why.kind, why.sentence) == (outcome.failure.kind, outcome.failure.sentence)
    assert log.goal[0].ravel().tolist() == [0.1, 0.05, 0.0325]
    _is_a_glimpse_of(outcome.glimpse, log)
    assert outcome.glimpse.goal[:3] == pytest.approx((0.1, 0.05, 0.0325), abs=1e-3)
    assert "glimpse" not in log.outcome, "the log has all poses anyway"
    assert json.loads(log.metadata["own_goal"]) == {"position_m": [0.1, 0.05, 0.0325]}


def _is_a_glimpse_of(glimpse, log):
    """Each of its poses was measured at its time, and the log ends with the last of them."""
    rows = np.searchsorted(log.joint_steps, np.round(1e3 * np.array(glimpse.t_s)).astype(int))
    np.testing.assert_allclose(glimpse.joint_position_rad, log.joint_position_rad[rows], atol=6e-4)
    reports = np.searchsorted(log.capture_s, np.array(glimpse.t_s) + 1e-9, side="right") - 1
    np.testing.assert_allclose(np.array(glimpse.tracked_pose)[:, :3], log.tracked_position_world_m[reports], atol=6e-4)
    assert len(glimpse.t_s) == 10 and glimpse.t_s[-1] > 0.95


def messages_of(log, topic):
    with log.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[DecoderFactory()])
        return [decoded for _, _, _, decoded in reader.iter_decoded_messages(topics=[topic])]


def test_a_log_says_when_it_began_by_the_wall_and_warns_of_what_went_wrong(short_log):
    began = datetime.fromisoformat(read_log(short_log).metadata["began_at"])
    assert timedelta(0) < datetime.now(UTC) - began < timedelta(hours=1) and began.utcoffset() == timedelta(0)
    events = messages_of(short_log, trial_log.EVENTS)
    said = {event.message: (event.level, event.name) for event in events}
    missed = next(text for text in said if text.startswith("goal missed"))
    assert said[missed] == (fm.LogLevel.Warning.value, trial_log.TRIAL_EVENT)
    assert {event.level for event in events} <= {fm.LogLevel.Info.value, fm.LogLevel.Warning.value}, "nothing was at fault"


def test_moments_are_events_at_their_own_times():
    witness = Witness()
    witness.take(0, np.zeros((3000, 9)), np.zeros((3000, 9)), np.zeros((3000, 9)))
    heights_m = np.where(np.arange(30) < 10, 0.0325, np.where(np.arange(30) < 20, 0.08, 0.0325))
    for index, height_m in enumerate(heights_m):
        witness._reports.append((index / 10, np.array([0.0, 0.0, height_m, 1, 0, 0, 0]), 1.0))
    goal = Goal(np.array([[0.0, 0.0, 0.08]]), np.array([[1.0, 0, 0, 0]]), np.zeros((1, 9)))
    found = [(moment.t_s, moment.text, moment.kind) for moment in witness.moments(goal, CUBE)]
    assert found == [(1.0, "at the goal", "ok"), (1.0, "lifted", "now"), (1.95, "dropped", "not"), (2.0, "left the goal", "not")]


def test_fingers_have_names_and_colours_in_the_scene(short_log):
    (scene,) = messages_of(short_log, trial_log.MEASURED_SCENE)
    texts = {text.text: entity.frame_id for entity in scene.entities for text in entity.texts}
    assert texts == {f"finger {name}": f"finger{name}_lower" for name in (0, 120, 240)}
    colours = {str(each.cylinders[0].color) for each in scene.entities if each.id.endswith("_middle")}
    assert len(colours) == 3
