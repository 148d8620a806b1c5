"""The life of an ideal robot: it has the shape of every life, and no effects."""

import contextlib
import dataclasses

import numpy as np

from api_schemas.physics import ObjectName
from robot_farm.hidden_physics import HiddenPhysics
from robot_farm.ideal_life import IdealLife
from robot_farm.life import Life
from robot_farm.robot import Robot
from robot_farm.settings import TOKEN_VARIABLE, Reset, parse
from robot_farm.truth import TruthFile, truth_channels
from sim_backend.effects.physics import Physics
from tests.unit.conftest import lease
from trial_logs.trial_log import CUBE_POSE

ASKED_BY_A_ROBOT = (
    "driver",
    "forget",
    "log_channels",
    "physics_digest",
    "prepare",
    "temperature_rise_k",
    "test_in_turn",
    "tests_ended",
    "wrong",
)


def prepared(life: IdealLife, folder, given):
    return life.prepare(given, TruthFile(folder / "truth.mcap", truth_channels()), lambda: None)


def test_it_has_all_that_a_robot_asks_of_a_life():
    other = Life("robot-0", HiddenPhysics(b"secret", "robot-0", "nominal").of_trial, Reset.PLACEMENT)
    for life in (IdealLife, other):
        assert set(ASKED_BY_A_ROBOT) <= set(dir(life))


def test_its_trials_begin_with_the_lease_alone(tmp_path):
    life = IdealLife()
    first, again = (prepared(life, tmp_path, lease(seed=7)) for _ in range(2))
    assert np.array_equal(first.start.cube_position_world_m, again.start.cube_position_world_m)
    assert first.physics.document() == Physics.nominal().document()
    assert (first.truth, first.alarm, first.changes, first.events) == (None, None, (), ())
    assert first.close(0, True) is None and (life.wrong, life.physics_digest) == (None, "")
    assert CUBE_POSE in life.log_channels().topics, "its logs hold the truth"


def test_it_keeps_its_driver_for_an_object_and_until_it_is_forgotten(tmp_path):
    life = IdealLife()
    prepared(life, tmp_path, lease())
    driver = life.driver
    prepared(life, tmp_path, lease(seed=6))
    assert life.driver is driver
    prepared(life, tmp_path, lease().model_copy(update={"object": ObjectName.SPHERE}))
    assert life.driver is not driver and life.driver.shape.name == "sphere"
    driver = life.driver
    life.forget()
    prepared(life, tmp_path, lease())
    assert life.driver is not driver


def test_it_takes_no_turn_to_test_itself():
    @contextlib.contextmanager
    def never():
        raise AssertionError("a turn was taken")
        yield

    assert IdealLife().test_in_turn(never(), lambda: None) is None


def test_a_robot_is_ideal_by_its_settings_alone(tmp_path, monkeypatch):
    monkeypatch.setenv(TOKEN_VARIABLE, "token")
    given = ["--api", "http://127.0.0.1:1", "--data", str(tmp_path), "--robot", "robot-0", "--physics"]
    settings = parse([*given, "nominal"])
    assert isinstance(Robot("robot-0", settings, print)._life, IdealLife)
    swept = Robot("robot-0", dataclasses.replace(settings, reset=Reset.SWEEP, farm_seed=5), print)._life
    assert isinstance(swept, Life) and len(swept.physics_digest) == 32
