"""Laws of joints: each is stepped with position, velocity and motor torque, and gives a torque on the joint (N m).

A law is made for steps of ``STEP_S``. Its state is plain attributes, so that ``copy.deepcopy`` of a law is its state.
"""

import math

import numpy as np

STEP_S = 0.00025
BRISTLE_RAD = 0.0002
"""Way over which friction turns round at standstill (elastic bristles, as in the LuGre model)."""
BRISTLE_LOSS = 0.2


class Friction:
    """Friction of all joints of an arm: dry, at standstill, by load and by direction, with bristles instead of a jump.

    All arguments have shape (joints,), in N m, rad/s or without unit. ``inertia_kg_m2`` sets how stiff bristles may
    be at this step.
    """

    def __init__(self, coulomb, extra, speed, load, direction, inertia_kg_m2):
        self.coulomb, self.extra, self.speed, self.load, self.direction = coulomb, extra, speed, load, direction
        self.inertia = inertia_kg_m2
        self.bend = np.zeros(len(coulomb))
        self.is_plain = not (np.any(extra) or np.any(load) or np.any(direction))

    def torque(self, velocity, motor, more):
        """Torque against the motion, and ``more`` dry friction (N m) that acts just now."""
        level = self.coulomb + more
        if not self.is_plain:
            level = level + self.extra * np.exp(-np.abs(velocity) / self.speed) + self.load * np.abs(motor)
            level = np.maximum(level + self.direction * np.sign(velocity), 0.0)
        way = np.maximum(BRISTLE_RAD, level * (STEP_S / 0.2) ** 2 / self.inertia)
        side = np.sign(velocity)
        self.bend = side + (self.bend - side) * np.exp(-np.abs(velocity) * STEP_S / way)
        # bristles that bend lose a little, so that nothing rings at standstill; never more than BRISTLE_LOSS of the friction
        most = BRISTLE_LOSS * level + 1e-12
        lost = np.sqrt(level / way * self.inertia) * (1.0 - self.bend**2) * velocity
        return -level * self.bend - lost / (1.0 + np.abs(lost) / most)


class Spring:
    """A cable that pulls a joint to a position."""

    def __init__(self, stiffness_nm_rad, reference_rad):
        self.stiffness, self.reference = stiffness_nm_rad, reference_rad

    def torque(self, t, q, v, motor):
        return -self.stiffness * (q - self.reference)


class Cogging:
    """Torque that follows the position with one frequency, whatever the motor gives."""

    def __init__(self, amplitude_nm, cycles_per_rad, phase_rad):
        self.amplitude, self.angular, self.phase = amplitude_nm, 2 * math.pi * cycles_per_rad, phase_rad

    def torque(self, t, q, v, motor):
        return self.amplitude * math.sin(self.angular * q + self.phase)


class OddRipple:
    """Ripple of a commutation: in proportion to the motor's torque, with third, fifth and seventh harmonic and no first."""

    def __init__(self, share, cycles_per_rad, phase_rad):
        self.share, self.angular, self.phase = share, 2 * math.pi * cycles_per_rad, phase_rad

    def torque(self, t, q, v, motor):
        angle = self.angular * q + self.phase
        return self.share * motor * (math.sin(3 * angle) + 0.6 * math.sin(5 * angle + 1.0) + 0.4 * math.sin(7 * angle + 2.0))


class BoucWen:
    """Hysteresis of Bouc and Wen: torque = amplitude z, dz = dq / width (1 - |z| (0.5 sign(dq z) + 0.5) |z|)."""

    def __init__(self, amplitude_nm, width_rad):
        self.amplitude, self.width, self.z = amplitude_nm, width_rad, 0.0

    def torque(self, t, q, v, motor):
        z = self.z
        self.z += STEP_S * v / self.width * (1.0 - z * z * 0.5 * (1.0 + math.copysign(1.0, v * z)))
        return -self.amplitude * self.z


class Magnet:
    """Attraction to one position, with a reach; largest at ``reach_rad`` beside it."""

    def __init__(self, peak_nm, place_rad, reach_rad):
        self.peak, self.place, self.reach = peak_nm, place_rad, reach_rad

    def torque(self, t, q, v, motor):
        away = (q - self.place) / self.reach
        return -self.peak * away * math.exp(0.5 - 0.5 * away * away)


class OneSidedCable:
    """A cable that is slack on one side and pulls on the other."""

    def __init__(self, stiffness_nm_rad, taut_rad, side):
        self.stiffness, self.taut, self.side = stiffness_nm_rad, taut_rad, side

    def torque(self, t, q, v, motor):
        stretch = self.side * (q - self.taut)
        return -self.side * self.stiffness * stretch if stretch > 0 else 0.0


class PaddleDrag:
    """Drag of air or oil that grows with the square of speed."""

    def __init__(self, coefficient_nm_s2_rad2):
        self.coefficient = coefficient_nm_s2_rad2

    def torque(self, t, q, v, motor):
        return -self.coefficient * v * abs(v)


class TightSpot:
    """Dry friction within a part of the way only, as a bent shaft has it; an amount for ``Friction.torque(more=...)``."""

    def __init__(self, torque_nm, place_rad, half_width_rad):
        self.level, self.place, self.half_width = torque_nm, place_rad, half_width_rad

    def dry(self, t, q):
        away = (q - self.place) / self.half_width
        return self.level * math.exp(-(away**4))


class IntermittentStick:
    """A brake that grips now and then for a moment; an amount of dry friction, ``grips`` with begin and end (s)."""

    def __init__(self, torque_nm, grips):
        self.level, self.grips = torque_nm, grips

    def dry(self, t, q):
        return self.level if any(begin <= t < end for begin, end in self.grips) else 0.0


class Drive:
    """A rotor beside its joint: play between the two, or a belt with memory; encoder, motor and bearing sit on the rotor.

    ``gap_rad`` is the width of the play, ``stiffness_nm_rad`` that of the contact or belt. A belt with memory has a second
    branch, a spring of ``memory_share`` times the stiffness behind a damper that lets it slip within ``memory_s``.
    """

    def __init__(self, rotor_kg_m2, stiffness_nm_rad, gap_rad=0.0, memory_share=0.0, memory_s=1.0, damping_ratio=0.15):
        self.rotor, self.stiffness, self.gap = rotor_kg_m2, stiffness_nm_rad, gap_rad
        self.memory_share, self.memory_s, self.slipped = memory_share, memory_s, 0.0
        self.damping = 2 * damping_ratio * math.sqrt(stiffness_nm_rad * rotor_kg_m2)
        self.q, self.v = 0.0, 0.0

    def place(self, q, v):
        """Put the rotor in the middle of its play."""
        self.q, self.v, self.slipped = q, v, 0.0

    def step(self, q_link, v_link, torque):
        """Move the rotor one step under ``torque``; the torque on the link, N m."""
        stretch = self.q - q_link
        beyond = stretch - math.copysign(min(abs(stretch), self.gap / 2), stretch)
        through = 0.0
        if beyond != 0.0:
            through = self.stiffness * beyond + self.damping * (self.v - v_link)
            if self.gap > 0.0 and through * beyond < 0.0:
                through = 0.0
        if self.memory_share:
            through += self.memory_share * self.stiffness * (stretch - self.slipped)
            self.slipped += STEP_S * (stretch - self.slipped) / self.memory_s
        self.v += STEP_S * (torque - through) / self.rotor
        self.q += STEP_S * self.v
        return through


class Motor:
    """From the commanded torque to that of the motors, all with shape (joints,): late, scaled, limited, weaker when warm.

    ``sag(t)`` is the factor that the supply leaves at a time. ``current`` is what a current sensor makes of it: neither an error
    of the torque constant nor warm magnets show there.
    """

    def __init__(self, delay_s, error, limit_nm, loss_per_k, rise_k_nm2, time_constant_s, sag=None):
        self.late = np.round(np.asarray(delay_s) / STEP_S).astype(int)
        self.error, self.limit, self.loss = error, limit_nm, loss_per_k
        self.rise, self.time_constant, self.sag = rise_k_nm2, time_constant_s, sag
        count = len(self.late)
        self.past = np.zeros((int(self.late.max(initial=0)) + 1, count))
        self.tick, self.joints = 0, np.arange(count)
        self.heat_k, self.current = np.zeros(count), np.zeros(count)

    def fill(self, command):
        """Take a command as one that has stood for long, as before a recording."""
        self.past[:] = command

    def torque(self, t, command):
        self.past[self.tick % len(self.past)] = command
        came = self.past[(self.tick - self.late) % len(self.past), self.joints]
        self.tick += 1
        if self.sag is not None:
            came = came * self.sag(t)
        self.current = np.minimum(np.maximum(came, -self.limit), self.limit)
        self.heat_k = self.heat_k + STEP_S * (self.rise * self.current**2 - self.heat_k) / self.time_constant
        return self.current * (1.0 + self.error) * (1.0 - self.loss * self.heat_k)
