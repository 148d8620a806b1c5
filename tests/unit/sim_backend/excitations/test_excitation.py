"""Excitations last as long as they say, are safe, and show the effects that they are for."""

import itertools
import re

import mujoco
import numpy as np
import pytest

from api_schemas.excitation import ExcitationName
from sim_backend.driver.driver import Command, Start
from sim_backend.driver.simulated import SimulatedDriver
from sim_backend.effects.physics import Physics
from sim_backend.effects.ranges import load_ranges
from sim_backend.excitations.course import COMMAND_STEPS, Sight
from sim_backend.excitations.cube_slide import MAX_START_RADIUS_M, draw_thrust
from sim_backend.excitations.excitation import EXCITATIONS
from sim_backend.tasks.task import draw_face_up_quat_wxyz, draw_in_disc, draw_start
from sim_backend.trifinger import constants as c
from tests import ROOT

PARTS = [name for name in EXCITATIONS if name not in {"slide_cube", "standard"}]
"""Of ``standard``, all in the air."""
LATE_COMMANDS = 12  # the tracker's 90 ms and half its period
NOWHERE = Sight(np.zeros(9), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))


def open_loop(name, seed=0):
    course = EXCITATIONS[name].course(np.random.default_rng(seed))
    steps = [next(course)]
    while True:
        try:
            steps.append(course.send(NOWHERE))
        except StopIteration:
            return steps


def run(name, physics, start, seed=0, share=1.0):
    """Segments of an excitation on n robots that get the same commands, fed with what the first one sees, late.

    All of them, or those of the first share of its time.
    """
    driver = SimulatedDriver(robots=physics.n, physics=physics)
    driver.reset(
        Start(
            *(
                np.repeat(x, physics.n, axis=0)
                for x in (start.joint_position_rad, start.cube_position_world_m, start.cube_quat_wxyz)
            )
        )
    )
    course, segments = EXCITATIONS[name].course(np.random.default_rng(seed)), []
    most = share * EXCITATIONS[name].duration_s / (c.PHYSICS_STEP_S * COMMAND_STEPS)
    command, steps = next(course)
    while True:
        if len(segments) >= most:
            return driver.model, segments
        command = Command(*(np.repeat(x, physics.n, axis=0) for x in (command.desired_torque_nm, command.position_target_rad)))
        segments.append(driver.advance([(command, steps)]))
        seen = segments[max(0, len(segments) - LATE_COMMANDS)]
        sight = Sight(driver.measure().joint_position_rad[0], seen.cube_position_world_m[0, 0], seen.cube_quat_wxyz[0, 0])
        try:
            command, steps = course.send(sight)
        except StopIteration:
            return driver.model, segments


def joined(segments, name):
    return np.concatenate([getattr(segment, name) for segment in segments], axis=1)


def touching(model, segments, every=10):
    """Names of the geoms that touch each other at any time, the cube on the table left out."""
    data, pairs = mujoco.MjData(model), set()
    states = np.concatenate(
        [joined(segments, key)[0] for key in ("true_joint_position_rad", "cube_position_world_m", "cube_quat_wxyz")], axis=1
    )
    for state in states[::every]:
        data.qpos[:] = state
        mujoco.mj_fwdPosition(model, data)
        pairs.update(map(tuple, data.contact.geom.tolist()))
    return {tuple(sorted(model.geom(geom).name for geom in pair)) for pair in pairs} - {("cube", "table")}


def near_the_centre(rng):
    place = np.array([[*draw_in_disc(rng, MAX_START_RADIUS_M), c.CUBE_REST_HEIGHT_M]])
    return Start(c.START_JOINT_POSITION_RAD[None], place, draw_face_up_quat_wxyz(rng)[None])


def test_names_are_those_of_the_job_and_the_page():
    assert tuple(EXCITATIONS) == tuple(name.value for name in ExcitationName)
    page = (ROOT / "docs" / "effects.md").read_text(encoding="utf-8")
    rows = dict(re.findall(r"^\| `(\w+)` \| (\d+) \| [^|]+ \| [^|]+ \|$", page, re.MULTILINE))
    assert {name: float(rows[name]) for name in EXCITATIONS} == {name: e.duration_s for name, e in EXCITATIONS.items()}


@pytest.mark.parametrize("name", EXCITATIONS)
def test_a_course_lasts_as_long_as_it_says_and_follows_from_its_seed(name):
    course, again, other = open_loop(name), open_loop(name), open_loop(name, seed=1)
    assert sum(steps for _, steps in course) * c.PHYSICS_STEP_S == pytest.approx(EXCITATIONS[name].duration_s)
    assert all(steps == COMMAND_STEPS for _, steps in course)
    targets = np.concatenate([command.position_target_rad for command, _ in course])
    torques = np.concatenate([command.desired_torque_nm for command, _ in course])
    assert targets.shape == torques.shape == (len(course), 9)
    assert (targets == np.concatenate([command.position_target_rad for command, _ in again])).all()
    if name != "joint_limits":  # two orders only, for each joint
        assert (targets != np.concatenate([command.position_target_rad for command, _ in other])).any()
    assert (targets >= c.SOFT_LIMIT_LOWER_RAD - 0.07).all()
    assert (targets <= c.SOFT_LIMIT_UPPER_RAD + 0.07).all()
    assert np.abs(torques).max() <= c.MAX_TORQUE_NM / 2
    assert np.abs(np.diff(targets, axis=0)).max() < 0.15
    assert targets[0] == pytest.approx(c.START_JOINT_POSITION_RAD, abs=0.1)


@pytest.mark.parametrize("name", [*PARTS, pytest.param("standard", marks=pytest.mark.scale)])
@pytest.mark.parametrize(("physics", "seed"), [("real", 4), pytest.param("nominal", 1, marks=pytest.mark.scale)])
def test_nothing_is_touched_wherever_the_cube_lies(name, physics, seed):
    """`test_nothing_is_touched_wherever_the_cube_lies` has all parts on the robot that is far from nominal without scale."""
    robot = Physics.nominal() if physics == "nominal" else load_ranges(physics).draw(np.random.default_rng(11), 1)
    model, segments = run(name, robot, draw_start(np.random.default_rng(seed)), seed)
    assert touching(model, segments) == set()
    cube = joined(segments, "cube_position_world_m")[0]
    assert cube == pytest.approx(cube[0] + np.zeros_like(cube), abs=1e-3)


VARIED = {
    "coulomb_friction.torque_nm": (0.03, 0.003),
    "viscous_friction.damping_nm_s_rad": (0.002, 0.002),
    "rotor_inertia.armature_kg_m2": (4e-4, 1e-4),
    "action_delay.delay_s": (0.002, 0.001),
    "torque_constant.error": (0.0, 0.03),
    "backlash.gap_rad": (0.002, 0.002),
    "encoder_offset.offset_rad": (0.0, 0.01),
    "load_friction.coefficient": (0.04, 0.02),
    "link_mass.factor": (1.0, 0.03),
}
"""A usual value and a change that matters, by parameter."""
LATE = {"fast_sweeps", "oscillations"}
"""What becomes faster from its beginning to its end shows late what it is for."""


@pytest.fixture(scope="module")
def responses():
    """What each change does to measured positions (mrad) and torques (5 mN m) in the first 20 % of an excitation, or 40 %.

    By excitation, shape (parameters, k, 18).
    """
    rows = [
        {key: value + (change if key == varied else 0.0) for key, (value, change) in VARIED.items()} for varied in (None, *VARIED)
    ]
    physics = Physics.of(len(rows), {key: np.array([row[key] for row in rows]) for key in VARIED})
    drawn, found, far = draw_start(np.random.default_rng(3)), {}, np.array([[0.0, 0.0, 1e5]])
    start = Start(drawn.joint_position_rad, far, drawn.cube_quat_wxyz)  # contacts of the cube would take most of the time
    for name in PARTS:
        _, segments = run(name, physics, start, seed=3, share=0.4 if name in LATE else 0.2)
        position, torque = joined(segments, "joint_position_rad"), joined(segments, "measured_torque_nm")
        measured = np.concatenate([position / 1e-3, torque / 5e-3], axis=2)[:, ::5]
        found[name] = measured[1:] - measured[:1]
    return found


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("slow_ramps", ["coulomb_friction.torque_nm", "load_friction.coefficient"]),
        ("fast_sweeps", ["viscous_friction.damping_nm_s_rad", "rotor_inertia.armature_kg_m2", "torque_constant.error"]),
        ("chirps", ["action_delay.delay_s", "rotor_inertia.armature_kg_m2", "torque_constant.error", "backlash.gap_rad"]),
        ("joint_limits", ["encoder_offset.offset_rad"]),
        ("oscillations", ["rotor_inertia.armature_kg_m2", "backlash.gap_rad", "link_mass.factor"]),
        ("hold_poses", ["torque_constant.error", "encoder_offset.offset_rad", "link_mass.factor"]),
    ],
)
def test_an_excitation_shows_what_it_is_for(responses, name, shown):
    for key in shown:
        response = responses[name][list(VARIED).index(key)]
        assert np.sqrt((response**2).mean()) > 0.3, f"{key} changes nothing that could be measured"


def test_together_they_tell_the_effects_apart(responses):
    every = np.concatenate([responses[name] for name in PARTS], axis=1).reshape(len(VARIED), -1)
    every /= np.linalg.norm(every, axis=1, keepdims=True)
    for (i, one), (j, other) in itertools.combinations(enumerate(VARIED), 2):
        assert abs(every[i] @ every[j]) < 0.95, f"{one} and {other} look alike"  # beyond it two causes count as confusable


def test_a_finger_can_push_from_every_allowed_start():
    rng = np.random.default_rng(0)
    for _ in range(300):
        start = near_the_centre(rng)
        sight = Sight(start.joint_position_rad[0], start.cube_position_world_m[0], start.cube_quat_wxyz[0])
        thrust = draw_thrust(rng, sight)
        assert thrust is not None
        assert np.linalg.norm(thrust.direction) == pytest.approx(1.0)


@pytest.mark.parametrize("seed", [0, 2, *(pytest.param(seed, marks=pytest.mark.scale) for seed in (1, 3))])
def test_the_cube_is_pushed_by_tips_and_nothing_else_is_touched(seed):
    """`test_the_cube_is_pushed_by_tips_and_nothing_else_is_touched` has a nominal robot and another without scale."""
    physics = Physics.nominal() if seed < 2 else load_ranges("real").draw(np.random.default_rng(seed), 1)
    model, segments = run("slide_cube", physics, near_the_centre(np.random.default_rng(seed)), seed)
    pairs = touching(model, segments)
    assert any(name.endswith("_tip") for pair in pairs for name in pair)
    assert all("cube" in pair for pair in pairs)
    cube = joined(segments, "cube_position_world_m")[0]
    assert np.linalg.norm(np.diff(cube[::100], axis=0), axis=1).sum() > 0.05
    assert np.hypot(*cube[-1, :2]) < c.MAX_CUBE_CENTRE_DISTANCE_M


def test_it_slides_on_after_the_push_and_further_on_a_slippery_table():
    start, further = near_the_centre(np.random.default_rng(5)), []
    for coefficient in (1.0, 0.2):
        physics = Physics.of(1, {"table_friction.coefficient": coefficient})
        _, segments = run("slide_cube", physics, start, seed=5)
        cube = joined(segments, "cube_position_world_m")[0, :7500]
        further.append(np.linalg.norm(cube[-1] - cube[0]))
    assert further[1] > 1.1 * further[0] > 0.0
