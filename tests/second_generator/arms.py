"""Serial arms of one to seven joints: what their owner declares (MJCF), and what stands there (1 % off everywhere)."""

import copy
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

GRAVITY_M_S2 = 9.81
IMPERFECTION = 0.01
"""Standard deviation of the relative error of each mass, inertia, friction and centre of mass; cut off at 2.5 times."""
GEARS = (1, 6, 9, 20, 50, 100)


@dataclass(frozen=True)
class Link:
    """A link and the hinge that carries it.

    ``offset_m`` leads from the last hinge to this one, ``com_m`` from this hinge to the centre of mass, ``inertia_kg_m2`` are the
    principal moments about that centre along the link's axes. Frictions and ``armature_kg_m2`` are those of the joint.
    """

    offset_m: tuple
    axis: tuple
    mass_kg: float
    com_m: tuple
    inertia_kg_m2: tuple
    armature_kg_m2: float = 0.0
    damping_nm_s_rad: float = 0.0
    frictionloss_nm: float = 0.0


@dataclass(frozen=True)
class LooseMass:
    """A mass that slides along a link between two stops, held by a weak spring."""

    link: int
    mass_kg: float
    place_m: tuple
    axis: tuple
    half_travel_m: float
    stiffness_n_m: float
    damping_n_s_m: float


@dataclass(frozen=True)
class Arm:
    """A serial arm; ``hanging`` says that all of it hangs at rest without any torque."""

    links: tuple[Link, ...]
    hanging: bool
    gear: int
    names: tuple[str, ...]
    home_rad: tuple[float, ...]
    torque_limit_nm: tuple[float, ...] = ()
    gravity_m_s2: tuple = (0.0, 0.0, -GRAVITY_M_S2)
    loose: LooseMass | None = field(default=None)

    @property
    def joints(self):
        """Number of joints."""
        return len(self.links)

    def inertia(self, position_rad=None):
        """Diagonal of the joint-space inertia at a position (home without it), kg m^2, shape (joints,)."""
        model = mujoco.MjModel.from_xml_string(self.mjcf())
        data = mujoco.MjData(model)
        data.qpos[: self.joints] = self.home_rad if position_rad is None else position_rad
        mujoco.mj_forward(model, data)
        dense = np.zeros((model.nv, model.nv))
        mujoco.mj_fullM(model, data, dense)
        return np.diag(dense)[: self.joints].copy()

    def mjcf(self):
        """The arm as MJCF; contacts are off, since nothing is touched."""
        lines = ['<mujoco model="arm">', '  <compiler angle="radian" inertiafromgeom="false"/>']
        gravity = " ".join(f"{value:.9g}" for value in self.gravity_m_s2)
        lines += [f'  <option timestep="0.001" integrator="implicitfast" gravity="{gravity}">', '    <flag contact="disable"/>']
        lines += ["  </option>", "  <worldbody>"]
        for i, link in enumerate(self.links):
            lines += _link_lines(i, link, self.names[i])
        for i in reversed(range(self.joints)):
            if self.loose is not None and self.loose.link == i:
                lines += _loose_lines(self.loose)
            lines.append("  " * (i + 2) + "</body>")
        lines += ["  </worldbody>", "  <actuator>"]
        for name, limit in zip(self.names, self.torque_limit_nm or (1.0,) * self.joints, strict=True):
            lines.append(f'    <motor name="{name}_motor" joint="{name}" gear="1" ctrlrange="{-limit:.6g} {limit:.6g}"/>')
        return "\n".join([*lines, "  </actuator>", "</mujoco>", ""])


def _numbers(values):
    return " ".join(f"{value:.9g}" for value in values)


def _link_lines(i, link, name):
    pad = "  " * (i + 2)
    joint = f'<joint name="{name}" type="hinge" axis="{_numbers(link.axis)}" range="-3 3" armature="{link.armature_kg_m2:.9g}"'
    inertia = f'<inertial pos="{_numbers(link.com_m)}" mass="{link.mass_kg:.9g}" diaginertia="{_numbers(link.inertia_kg_m2)}"/>'
    return [
        f'{pad}<body name="link{i + 1}" pos="{_numbers(link.offset_m)}">',
        f'{pad}  {joint} damping="{link.damping_nm_s_rad:.9g}" frictionloss="{link.frictionloss_nm:.9g}"/>',
        f"{pad}  {inertia}",
    ]


def _loose_lines(loose):
    joint = f'<joint type="slide" axis="{_numbers(loose.axis)}" limited="true"'
    travel = f'range="{-loose.half_travel_m:.9g} {loose.half_travel_m:.9g}" solreflimit="0.004 0.7"'
    small = max(1e-6, loose.mass_kg * 1e-4)
    return [
        f'<body name="loose" pos="{_numbers(loose.place_m)}">',
        f'  {joint} {travel} stiffness="{loose.stiffness_n_m:.9g}" damping="{loose.damping_n_s_m:.9g}"/>',
        f'  <inertial pos="0 0 0" mass="{loose.mass_kg:.9g}" diaginertia="{small:.3g} {small:.3g} {small:.3g}"/>',
        "</body>",
    ]


def draw_arm(rng, joints):
    """An arm with drawn lengths, masses, motors and bearings, as its owner would declare it."""
    hanging = joints < 4 and bool(rng.random() < 0.6)
    reach_m = rng.uniform(0.25, 0.6) + 0.08 * joints
    lengths = rng.uniform(0.7, 1.3, joints) * reach_m / joints
    # a base is heavy, a wrist light
    masses = rng.uniform(2.0, 8.0) * reach_m * rng.uniform(0.7, 1.3, joints) * np.linspace(1.0, 0.5, joints) / joints**0.5
    axes = [(0, 1, 0) if hanging or i % 2 == 1 else (0, 0, 1) for i in range(joints)]
    if joints == 1:
        axes = [(0, 1, 0)]
    down = -1.0 if hanging or joints < 7 else 1.0
    links = []
    for i in range(joints):
        side = 0.0 if hanging else rng.uniform(0.05, 0.2) * lengths[i]
        com = (float(f"{side:.3g}"), 0.0, float(f"{down * lengths[i] * rng.uniform(0.4, 0.6):.3g}"))
        across = masses[i] * lengths[i] ** 2 / 12 * rng.uniform(0.8, 1.4)
        moments = (across, across * rng.uniform(0.9, 1.1), across * rng.uniform(0.15, 0.4))
        offset = (0.0, 0.0, 0.0 if i == 0 else float(f"{down * lengths[i - 1]:.3g}"))
        moments = tuple(float(f"{value:.3g}") for value in moments)
        links.append(Link(offset, axes[i], float(f"{masses[i]:.3g}"), com, moments))
    home = np.zeros(joints) if hanging else np.array([0.0 if i % 2 == 0 else rng.uniform(0.4, 0.8) for i in range(joints)])
    prefix = str(rng.choice(["joint", "j", "axis_"]))
    names = tuple(f"{prefix}{i + 1}" for i in range(joints))
    arm = Arm(tuple(links), hanging, int(rng.choice(GEARS)), names, tuple(float(f"{value:.2f}") for value in home))
    return _with_drives(rng, arm)


def _with_drives(rng, arm):
    """Motors and bearings that go with the links' inertia."""
    inertia = arm.inertia()
    armature = inertia * np.exp(rng.uniform(np.log(0.15), np.log(1.2), arm.joints)) + 0.05 * inertia.max() / 8**arm.joints**0.5
    total = inertia + armature
    damping = 2 * rng.uniform(0.03, 0.12, arm.joints) * 4.0 * total
    friction = np.exp(rng.uniform(np.log(0.3), np.log(2.5), arm.joints)) * total
    limit = (total * 80.0 + hanging_torque(arm) * 2.0) * 1.5
    links = [
        replace(
            link,
            armature_kg_m2=float(f"{armature[i]:.3g}"),
            damping_nm_s_rad=float(f"{damping[i]:.2g}"),
            frictionloss_nm=float(f"{friction[i]:.2g}"),
        )
        for i, link in enumerate(arm.links)
    ]
    return replace(arm, links=tuple(links), torque_limit_nm=tuple(float(f"{value:.2g}") for value in limit))


def hanging_torque(arm):
    """Largest torque of gravity on each joint that the links' lengths allow, N m, shape (joints,)."""
    torque = np.zeros(arm.joints)
    for i in range(arm.joints):
        along = 0.0
        for k in range(i, arm.joints):
            along += abs(arm.links[k].offset_m[2]) if k > i else 0.0
            torque[i] += arm.links[k].mass_kg * GRAVITY_M_S2 * (along + np.linalg.norm(arm.links[k].com_m))
    return torque


def shaken(rng, arm):
    """The arm that stands there: every mass, inertia, friction and length of a centre of mass about 1 % off the declared one."""

    def off(count=1):
        return 1.0 + IMPERFECTION * np.clip(rng.standard_normal(count), -2.5, 2.5)

    links = []
    for link in arm.links:
        links.append(
            replace(
                link,
                mass_kg=link.mass_kg * float(off()[0]),
                com_m=tuple(np.array(link.com_m) * off(3)),
                inertia_kg_m2=tuple(np.array(link.inertia_kg_m2) * off(3)),
                armature_kg_m2=link.armature_kg_m2 * float(off()[0]),
                damping_nm_s_rad=link.damping_nm_s_rad * float(off()[0]),
                frictionloss_nm=link.frictionloss_nm * float(off()[0]),
            )
        )
    return replace(copy.copy(arm), links=tuple(links))
