"""The number of robots follows what the queue wishes as Kubernetes would have it follow."""

import yaml

from tests.benchmarks.pods import SCALED_OBJECT, Autoscaler


def scaler(replicas=1):
    return Autoscaler(yaml.safe_load(SCALED_OBJECT.read_text())["spec"], replicas)


def test_a_queue_is_met_with_a_robot_for_each_four_trials_and_no_more_than_sixteen_a_minute():
    robots = scaler()
    assert robots.look(0.0, 40.0) == 10
    assert [robots.look(at_s, 400.0) for at_s in (15.0, 30.0, 45.0, 60.1)] == [17, 17, 17, 26]


def test_robots_go_when_nothing_was_wished_for_five_minutes_half_of_them_a_minute():
    robots = scaler(16)
    assert [robots.look(at_s, 64.0) for at_s in (0.0, 60.0)] == [16, 16]
    assert [robots.look(at_s, 0.0) for at_s in range(120, 361, 60)] == [16] * 5
    assert [robots.look(at_s, 0.0) for at_s in (361.0, 421.1, 481.2, 541.3, 601.4)] == [8, 4, 2, 1, 1]


def test_a_tenth_more_or_less_changes_nothing():
    assert scaler(10).look(0.0, 43.0) == 10
    assert scaler(10).look(0.0, 45.0) == 12
