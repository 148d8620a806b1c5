"""Replays follow what was simulated, and the measurement's scale acts on what is seen alone."""

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.tosses.geometry import geometry_of
from sim_backend.reality_gap.subjects.tosses.models import FRICTION
from sim_backend.reality_gap.subjects.tosses.replay import HEIGHT, SCALE, Replayer, replay_step_s, replayed, settled
from sim_backend.reality_gap.subjects.tosses.stretches import tosses_of
from tests.unit.sim_backend.reality_gap.subjects.tosses.simulated_tosses import toss_spec, tosses


def _replay(values, scale=1.0):
    spec = toss_spec()
    geometry = geometry_of(spec.copy().compile(), "thing")
    found = tosses_of(geometry, tosses(spec, 8, 5, scale=scale, noise_m=0.0, noise_rad=0.0))
    replayer = Replayer(spec, geometry, replay_step_s(found))
    paths = replayed(replayer, found, values)
    errors = [np.linalg.norm(path[0] - toss.position_m, axis=1).mean() for path, toss in zip(paths, found, strict=True)]
    return np.median(errors) / geometry.width_m, replayer, found


def test_the_true_model_follows_and_a_wrong_one_does_not():
    true, *_ = _replay({})
    assert true < 0.05
    assert _replay({FRICTION: 1.0})[0] > 3.0 * true


def test_a_scale_is_undone_before_and_done_after_the_physics():
    right, wrong = _replay({SCALE: 0.05}, scale=1.05)[0], _replay({}, scale=1.05)[0]
    assert right < 0.05 < 2.0 * wrong


def test_offsets_move_what_is_seen():
    _, replayer, found = _replay({})
    seen, moved = (replayed(replayer, found[:1], {HEIGHT: height})[0][0] for height in (0.0, 0.01))
    assert seen[0] == pytest.approx(moved[0])
    assert seen[3, 2] - moved[3, 2] == pytest.approx(0.0, abs=1e-6)
    assert moved[-1, 2] - seen[-1, 2] == pytest.approx(0.01, abs=2e-3)


def test_a_tilted_pose_settles_flat():
    _, replayer, _ = _replay({})
    quat = np.array([[np.cos(0.01), np.sin(0.01), 0.0, 0.0]])
    position, settled_quat = settled(replayer, (np.array([[0.1, 0.0, 0.052]]), quat), {})
    assert position[0, 2] == pytest.approx(0.05, abs=3e-4)
    assert abs(settled_quat[0, 1]) < 2e-3
