"""mujoco_warp moves the robots as MuJoCo does, with every effect, each robot with its own; on Warp's processor device."""

import sys

import numpy as np
import pytest

from sim_backend.driver import warp_batch
from sim_backend.driver.driver import Segment
from sim_backend.driver.physics_backend import PhysicsBackend
from sim_backend.driver.physics_batch import BackendError
from sim_backend.driver.simulated import PhysicsDivergedError, SimulatedDriver
from sim_backend.effects.effect import Acts
from sim_backend.effects.physics import Physics
from sim_backend.trifinger.objects import CUBE, shape_of
from tests.unit.sim_backend.driver.backends import WARP_IS_MISSING, needs_warp
from tests.unit.sim_backend.effects.rig import CATALOGUE, c, go_to, present, run, start_of

STEP_S = 0.004
PUSHING_RAD, LETTING_RAD = np.tile([0.0, 0.6, -1.9], 3), np.tile([0.1, 0.9, -1.6], 3)
ON_JOINTS = [effect.name for effect in CATALOGUE.values() if effect.acts in (Acts.MODEL, Acts.CONTROL)]
NEAR_LIMITS_RAD = np.tile([0.8, 1.4, -0.2], 3)
FIELDS = {
    "true_joint_position_rad": 2e-3,
    "cube_position_world_m": 5e-4,
    "cube_quat_wxyz": 5e-3,
    "applied_torque_nm": 5e-3,
    "effective_torque_nm": 5e-3,
    "joint_position_rad": 2e-3,
}
"""What is compared over 250 steps of 4 ms, and the largest difference; for nominal robots a fortieth of it. With a delay of 33 ms
the fingers swing ever more, and what differs grows with them; nearly all others stay below a hundredth of it."""
BEFORE_THEY_DIVERGE = {"action_delay": 125, "load_friction": 200}
"""Steps after which a course is not compared: fingers that swing ever more touch each other, and friction by the load from
outside has the load of a step before, which moves a finger that is caught by 24 mrad."""
LOOSER = {"load_friction": 3}
"""Times the largest difference, for the same reason."""


def driver(backend: str, physics: Physics | None = None, n: int = 1, **settings) -> SimulatedDriver:
    return SimulatedDriver(robots=n, physics=physics, physics_step_s=STEP_S, backend=PhysicsBackend(backend), **settings)


def joined(segments: list[Segment]) -> dict[str, np.ndarray]:
    return {name: np.concatenate([getattr(each, name) for each in segments], axis=1) for name in FIELDS}


def course(backend: str) -> dict[str, np.ndarray]:
    """A nominal robot and one for each effect: push the cube, let it go, swing out and in; then run into the joints' ends."""
    physics = Physics.stack([Physics.nominal(), *(Physics.of(1, present(CATALOGUE[name])) for name in ON_JOINTS)])
    robots = driver(backend, physics, physics.n)
    robots.reset(start_of(physics.n, joints=c.START_JOINT_POSITION_RAD))
    segments = [go_to(robots, PUSHING_RAD, 100), go_to(robots, LETTING_RAD, 50), run(robots, 0.3, 50), run(robots, -0.3, 50)]
    robots.reset(start_of(physics.n, joints=NEAR_LIMITS_RAD))
    return joined([*segments, run(robots, 0.2, 50)])


@pytest.fixture(scope="module")
def courses() -> dict[str, dict[str, np.ndarray]]:
    return {backend: course(backend) for backend in ("cpu", "warp-cpu")}


def falling(robots: SimulatedDriver) -> list[Segment]:
    robots.reset(start_of(cube=(0.0, 0.0, 0.15)))
    return [run(robots, 0.0, 300)]


def driven(robots: SimulatedDriver) -> list[Segment]:
    robots.reset(start_of())
    rng = np.random.default_rng(2)
    return [run(robots, rng.uniform(-0.3, 0.3, 9), 20) for _ in range(15)]


def pushing(robots: SimulatedDriver) -> list[Segment]:
    robots.reset(start_of())
    return [go_to(robots, PUSHING_RAD, 150), go_to(robots, LETTING_RAD, 150)]  # 1.2 s, as the others


@needs_warp
@pytest.mark.parametrize("move", [falling, driven, pushing])
def test_a_nominal_robot_moves_as_in_mujoco(move):
    here, there = (joined(move(driver(backend))) for backend in ("cpu", "warp-cpu"))
    for name, tolerance in FIELDS.items():
        np.testing.assert_allclose(there[name], here[name], rtol=0, atol=tolerance / 40, err_msg=name)
    moved = np.ptp(here["cube_position_world_m"], axis=1).max()
    assert move is driven or moved > 0.02


@needs_warp
@pytest.mark.parametrize("effect", ON_JOINTS)
def test_an_effect_of_one_robot_among_many_acts_as_in_mujoco(effect, courses):
    row, until = 1 + ON_JOINTS.index(effect), BEFORE_THEY_DIVERGE.get(effect, 250)
    compared = np.r_[:until, 250:300]
    for name, tolerance in FIELDS.items():
        there, here = (courses[backend][name][row][compared] for backend in ("warp-cpu", "cpu"))
        np.testing.assert_allclose(there, here, rtol=0, atol=tolerance * LOOSER.get(effect, 1), err_msg=name)
    here = courses["warp-cpu"]
    apart = [np.abs(here[name][row] - here[name][0]).max() / tolerance for name, tolerance in FIELDS.items()]
    assert max(apart) > 2, "the course does not show the effect"


@needs_warp
def test_robots_change_their_physics_between_trials_and_go_back_to_nominal():
    changed = Physics.of(1, {"cube_mass.factor": 2.5, "table_friction.coefficient": 0.2, "coulomb_friction.torque_nm": 0.05})
    kept = {}
    for backend in ("cpu", "warp-cpu"):
        robots = driver(backend, n=2)
        robots.reset(start_of(2))
        go_to(robots, PUSHING_RAD, 20)
        robots.set_physics(changed, np.array([1]))
        robots.reset(start_of(1), np.array([1]))
        first = go_to(robots, PUSHING_RAD, 100)
        robots.set_physics(Physics.nominal(2))
        robots.reset(start_of(2))
        kept[backend] = joined([first]), joined([go_to(robots, PUSHING_RAD, 100)])
    for here, there in zip(kept["cpu"], kept["warp-cpu"], strict=True):
        for name, tolerance in FIELDS.items():
            np.testing.assert_allclose(there[name], here[name], rtol=0, atol=tolerance, err_msg=name)
    changed_there, nominal_there = (each["cube_position_world_m"] for each in kept["warp-cpu"])
    assert np.abs(changed_there[1] - nominal_there[1]).max() > 1e-3
    np.testing.assert_array_equal(nominal_there[0], nominal_there[1])


@needs_warp
def test_an_effect_that_cannot_be_had_is_refused_by_name():
    with pytest.raises(BackendError, match=r"cube_size.*mesh_vert.*once for all"):
        driver("warp-cpu", Physics.of(1, {"cube_size.factor": 1.1}), shape=shape_of("octagonal_prism"))
    driver("warp-cpu", Physics.of(1, {"cube_size.factor": 1.1}), shape=CUBE)


@needs_warp
def test_an_unstable_simulation_is_marked_and_leaves_the_others_alone():
    robots, alone = driver("warp-cpu", n=3, divergence_ends=False), driver("warp-cpu", n=3)
    for each in (robots, alone):
        each.reset(start_of(3))
    robots._qvel[1] = 1e12
    here, there = run(robots, 0.1, 20), run(alone, 0.1, 20)
    assert robots.diverged.tolist() == [False, True, False]
    np.testing.assert_array_equal(here.true_joint_position_rad[[0, 2]], there.true_joint_position_rad[[0, 2]])
    robots.reset(start_of(1), np.array([1]))
    assert not robots.diverged.any()
    alone._qvel[1] = np.nan
    with pytest.raises(PhysicsDivergedError):
        run(alone, 0.1, 1)


@needs_warp
def test_a_simulation_with_more_contacts_than_there_is_room_for_is_marked(monkeypatch):
    monkeypatch.setattr(warp_batch, "CONSTRAINTS", 6)
    robots = driver("warp-cpu", n=2, divergence_ends=False)
    start = start_of(2)
    start.cube_position_world_m[1, 2] = 0.3  # four contacts with the table in the first, none in the second
    robots.reset(start)
    run(robots, 0.0, 3)
    assert robots.diverged.tolist() == [True, False]


def test_without_the_extra_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)
    with pytest.raises(BackendError, match=r"not installed \(.*warp.*\): pip install -e '\.\[gpu\]'"):
        driver("warp")


@needs_warp
def test_without_a_gpu_it_says_so():
    import warp

    if warp.is_cuda_available():
        pytest.skip("there is a GPU")
    with pytest.raises(BackendError, match=r"needs an NVIDIA GPU.*leave physics_backend at 'cpu'"):
        driver("warp")


@pytest.mark.skipif(WARP_IS_MISSING, reason="the extra 'gpu' (mujoco_warp) is not installed, so no GPU can be tried")
def test_a_gpu_moves_the_robots_as_mujoco_does():
    import warp

    if not warp.is_cuda_available():
        pytest.skip("no GPU here: the tests ran on Warp's processor device only")
    here, there = (joined(pushing(driver(backend))) for backend in ("cpu", "warp"))
    for name, tolerance in FIELDS.items():
        np.testing.assert_allclose(there[name], here[name], rtol=0, atol=tolerance / 40, err_msg=name)
