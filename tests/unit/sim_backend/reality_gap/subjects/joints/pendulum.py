"""A pendulum whose controller, motor and losses are known: recordings of it, and what a study by rollouts makes of them."""

from dataclasses import replace

import mujoco
import numpy as np

from sim_backend.reality_gap.feedback import Feedback
from sim_backend.reality_gap.knowledge.known_of_robot import Tolerance, UnknownRobot
from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.identification import JointStudy, study_joints
from sim_backend.reality_gap.subjects.joints.rollouts.forward import Windows
from sim_backend.reality_gap.subjects.joints.rollouts.healthy_robots import DrawnRobots
from sim_backend.reality_gap.subjects.joints.rollouts.limits import enough_of, limits_of
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_fit import RolloutProblem
from sim_backend.reality_gap.subjects.joints.rollouts.rollout_selection import RolloutSelection, select_by_rollouts
from sim_backend.reality_gap.subjects.joints.verdicts.needed_causes import with_needed_causes
from sim_backend.reality_gap.subjects.joints.verdicts.verdict_of_rollouts import verdict_of_rollouts
from sim_backend.reality_gap.verdict import Verdict

PENDULUM = """
<mujoco><option timestep="0.0005" integrator="implicitfast"/><worldbody>
 <body name="arm"><joint name="hinge" type="hinge" axis="0 1 0" armature="0.001" {more}/>
  <inertial pos="0 0 -0.15" mass="0.6" diaginertia="1e-3 1e-3 1e-3"/></body>
</worldbody><actuator><motor joint="hinge"/></actuator></mujoco>
"""
STEP_S = 0.005
GAIN, DAMPING = 3.0, 0.1
LIMIT_NM = 0.8
PUSHED_EVERY, PUSHED_ROWS = 800, 8
LOSS_NM2, WARMS_S = 0.5, 4.0
COGS, COGGING_NM = 42, 0.05
STICKS_RAD_S = 1.2
RIGID = {"solref": [0.004, 1.0], "solimp": [0.999, 0.9999, 0.001, 0.5, 2.0]}
"""Of friction that holds: by default MuJoCo's gives way in proportion to slow speeds."""
NO_LIMIT = {"torque_saturation.limit_nm": np.array([1e9])}


def recorded(
    model: mujoco.MjModel,
    target_rad: np.ndarray,
    *,
    seed: int = 0,
    noise_rad: float = 1e-4,
    of_gain: float = 1.0,
    limit_nm: float = np.inf,
    loss_nm2: float = 0.0,
    late_rows: int = 0,
    targets_late_rows: int = 0,
    on_board: bool = False,
    cogging_nm: float = 0.0,
    lost: float = 0.0,
    bristles_nm: float = 0.0,
    give_rad: float = 1e-3,
    pushed_nm: float = 0.0,
    sticking_nm: float = 0.0,
) -> Recording:
    """A PD controller follows targets at 200 Hz; positions have noise, which the controller sees.

    Its motor has a limit, loses a share of its torque, gets warm within ``WARMS_S`` and loses then, acts some rows late, and cogs
    ``COGS`` times a turn. The controller gets its targets some rows late; one that is on board computes its torque in every step,
    of where the joint is. Friction of bristles gives before it slips; what sticks falls to 1/e at ``STICKS_RAD_S``, without a
    bell's flat top. Somebody pushes it for ``PUSHED_ROWS`` of ``PUSHED_EVERY`` rows.
    """
    target_rad = np.concatenate([np.repeat(target_rad[:1], targets_late_rows), target_rad])[: len(target_rad)]
    data, rng = mujoco.MjData(model), np.random.default_rng(seed)
    if sticking_nm:
        model.dof_solref[0], model.dof_solimp[0] = RIGID["solref"], RIGID["solimp"]
    found, warm, bend, sent = np.empty((3, len(target_rad))), 0.0, 0.0, [0.0] * late_rows
    for i, target in enumerate(target_rad):
        position = data.qpos[0] + noise_rad * rng.standard_normal()
        sent_nm = of_gain * GAIN * (target - position) - DAMPING * data.qvel[0]
        found[:, i] = position, data.qvel[0], sent_nm
        sent.append(np.clip(sent_nm, -limit_nm, limit_nm))
        warm += STEP_S / WARMS_S * (sent[i] ** 2 - warm)
        data.ctrl[0] = sent[i] * (1.0 - lost) * (1.0 - loss_nm2 * warm) + cogging_nm * np.sin(COGS * data.qpos[0] + 0.4)
        for _ in range(round(STEP_S / model.opt.timestep)):
            if on_board:
                data.ctrl[0] = of_gain * GAIN * (target - data.qpos[0]) - DAMPING * data.qvel[0]
            bend = np.clip(bend + model.opt.timestep * data.qvel[0] / give_rad, -1.0, 1.0)
            data.qfrc_applied[0] = pushed_nm * (i % PUSHED_EVERY >= PUSHED_EVERY - PUSHED_ROWS) - bristles_nm * bend
            if sticking_nm:
                model.dof_frictionloss[0] = sticking_nm * np.exp(-abs(data.qvel[0]) / STICKS_RAD_S)
            mujoco.mj_step(model, data)
    position, velocity, torque = (row[:, None] for row in found)
    joints = JointSignals(("hinge",), position, velocity, commanded_torque_nm=torque)
    return Recording("swing", "made here", STEP_S, STEP_S * np.arange(len(target_rad)), joints)


def targets(seconds: float, seed: int) -> np.ndarray:
    """Sums of slow and fast sines."""
    time_s, rng = np.arange(0.0, seconds, STEP_S), np.random.default_rng(seed)
    phases = rng.uniform(0.0, 2.0 * np.pi, 4)
    return sum(0.4 * np.sin(2.0 * np.pi * f * time_s + phase) for f, phase in zip((0.2, 0.5, 0.9, 1.7), phases, strict=True))


def one_window(position: np.ndarray, sent: np.ndarray, feedback: Feedback | None = None) -> Windows:
    begin = np.zeros((1, 1))
    return Windows(STEP_S, position, begin, begin, sent, feedback, np.zeros(1, int))


def study_of(
    hidden: str | mujoco.MjModel,
    *,
    tolerance: Tolerance | None = None,
    seconds: float = 6.0,
    gravity_m_s2: float = 9.81,
    then: mujoco.MjModel | None = None,
    **of_motor: float,
):
    """Judge two recordings of a pendulum that has more than its model, or of another, and a motor as :func:`recorded` has it.

    The second one is of the pendulum ``then``, if there is one.
    """
    nominal = mujoco.MjModel.from_xml_string(PENDULUM.format(more=""))
    model = mujoco.MjModel.from_xml_string(PENDULUM.format(more=hidden)) if isinstance(hidden, str) else hidden
    model.opt.gravity[2] = -gravity_m_s2
    recordings = [
        replace(recorded(each, targets(seconds, seed), seed=seed, **of_motor), name=f"swing {seed}")
        for seed, each in ((1, model), (2, then or model))
    ]
    robot = UnknownRobot(tolerance or Tolerance())
    study = study_joints(nominal, recordings, lambda *_: None, robot=robot, gate=np.inf)
    problem = RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, robot.tolerance)
    robots, enough = DrawnRobots(problem, np.random.default_rng(0)), enough_of(problem)
    selection = select_by_rollouts(
        problem,
        study.fit.first.catalogue,
        lambda _: True,
        healthy_rad=robots.coarse.fitted_rad,
        enough_rad=enough.usual_rad,
        is_healthy=lambda fit: limits_of(robots, fit, enough).hold(fit),
    )
    others = robots
    if selection.taken:
        others = DrawnRobots(selection.problem, np.random.default_rng(1), around=selection.fit)
        selection = with_needed_causes(selection, lambda fit: limits_of(others, fit, enough), lambda _: True)
    return judged(study, selection, robots, others)


def judged(study: JointStudy, selection: RolloutSelection, robots: DrawnRobots, others: DrawnRobots | None = None) -> Verdict:
    """A verdict beside healthy robots, and others that have the causes."""
    enough = enough_of(selection.problem)
    healthy, with_causes = limits_of(robots, selection.nominal, enough), limits_of(others or robots, selection.fit, enough)
    return verdict_of_rollouts(study, selection, healthy, with_causes)


def problem_of(limit_nm: float = np.inf, hidden: str = "") -> RolloutProblem:
    """Windows of a pendulum whose motor ends somewhere, and which has more than its model."""
    nominal, model = (mujoco.MjModel.from_xml_string(PENDULUM.format(more=more)) for more in ("", hidden))
    robot = UnknownRobot(Tolerance())
    recordings = [replace(recorded(model, targets(6.0, seed), seed=seed, limit_nm=limit_nm), name=f"{seed}") for seed in (1, 2)]
    study = study_joints(nominal, recordings, lambda *_: None, robot=robot, gate=np.inf)
    return RolloutProblem(study.problem.episodes, study.start, study.fit.first.catalogue, robot.tolerance)


def only_targets(recording: Recording, target_rad: np.ndarray, *, on_board: bool = False) -> Recording:
    """The same where nobody recorded a torque, but what the controller is said to be."""
    assert recording.joints is not None
    law = [np.full((len(target_rad), 1), value) for value in (0.0, GAIN, DAMPING, np.inf, 0.0, 0.0, float(on_board))]
    law[0][:, 0] = target_rad
    feedback, joints = Feedback(*law), recording.joints
    assert joints.velocity_rad_s is not None
    believed_nm = feedback.torque_nm(joints.position_rad, joints.velocity_rad_s)
    return replace(recording, joints=replace(joints, commanded_torque_nm=believed_nm, feedback=feedback, not_recorded=("hinge",)))
