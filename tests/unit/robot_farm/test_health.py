"""What a robot tells of itself with each heartbeat."""

from datetime import datetime
from types import SimpleNamespace

import numpy as np

from robot_farm.health import WatchedHealth
from robot_farm.ideal_life import IdealLife
from robot_farm.run import Progress
from tests.unit.robot_farm.living import Living


def test_an_ideal_robot_knows_its_tracker_alone():
    progress = Progress()
    watched = WatchedHealth(lambda: progress, IdealLife())
    assert watched.health().model_dump() == {"motor_temperature_rise_k": None, "tracker_confidence": None, "self_test": None}
    progress.tracked = SimpleNamespace(confidence=np.array([0.8126]))
    assert watched.health().tracker_confidence == 0.813
    progress.tracked = SimpleNamespace(confidence=np.array([np.nan]))
    assert watched.health().tracker_confidence is None, "and the heartbeat goes on"
    progress.tracked = SimpleNamespace(confidence=np.array([0.8126]))
    watched.health()
    progress = Progress()  # the next trial has seen nothing yet
    assert watched.health().tracker_confidence == 0.813


def test_a_self_test_is_told_from_its_end_on(tmp_path):
    life = Living(tmp_path).life
    watched = WatchedHealth(Progress, life)
    assert watched.health().self_test is None
    assert life.test_again(lambda: None) is None
    told = watched.health()
    assert told.self_test.wrong is None and datetime.fromisoformat(told.self_test.at).tzinfo is not None
    assert told.motor_temperature_rise_k > 0, "moving has warmed the motors"
    assert watched.health().self_test == told.self_test
