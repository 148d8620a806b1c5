"""One case from its seed, kind and index: arm, sensors, recordings and hidden causes."""

from dataclasses import dataclass, field, replace

import numpy as np

from tests.second_generator import causes, excitations, outside, visibility
from tests.second_generator.arms import Arm, draw_arm, hanging_torque, shaken
from tests.second_generator.causes import Seen
from tests.second_generator.plant import Plant, Trace, plain_body, run
from tests.second_generator.seeds import KINDS, case_rng

RATES_HZ = (100, 125, 200, 250, 400, 500, 1000)
LEAST_VISIBILITY, LARGEST_VISIBILITY = 1.0, 60.0
PILOT_S = 8.0
LARGEST_MISS_RAD = 0.6
"""Beyond this error of following an experimenter would have stopped."""


@dataclass(frozen=True)
class Sensors:
    """What the owner's sensors do in a healthy arm; arrays have shape (joints,)."""

    step_rad: np.ndarray
    noise_rad: np.ndarray
    velocity_noise_rad_s: float
    torque_noise_share: float
    rise_k_nm2: np.ndarray
    warming_s: np.ndarray


@dataclass(frozen=True)
class Session:
    """How an arm was driven and what was written down."""

    period_s: float
    is_closed: bool
    only_targets: bool
    has_velocity: bool
    has_measured: bool
    has_temperature: bool
    kinds: tuple[str, ...]
    seconds: tuple[float, ...]
    amplitude: np.ndarray
    shapes: tuple = ()
    stiffness: np.ndarray = field(default_factory=lambda: np.zeros(0))
    damping: np.ndarray = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class Cause:
    """A hidden cause: its name, whether the catalogue lacks it, the joints, its size from 0 to 1, a seed for the rest."""

    name: str
    is_outside: bool
    joints: tuple[int, ...]
    size: float
    seed: int
    visibility: float = 0.0


@dataclass(frozen=True)
class Case:
    """All of a case, still without files."""

    seed: int
    kind: str
    index: int
    declared: Arm
    true: Arm
    sensors: Sensors
    session: Session
    causes: tuple[Cause, ...]
    seen: Seen
    traces: tuple[Trace, ...] = ()


def names_of(seed, kind, index):
    """Names of the hidden causes of a case: every name comes once in each round of the catalogue, in an order of the seed."""
    if kind == "healthy":
        return ()
    all_names = tuple(outside.OUTSIDE if kind == "outside" else causes.CATALOGUE)

    def name(place, salt):
        rng = np.random.default_rng([seed, KINDS.index(kind), 1_000_000 + salt, place // len(all_names)])
        return all_names[rng.permutation(len(all_names))[place % len(all_names)]]

    first = name(index, 0)
    if kind != "double":
        return (first,)
    forbidden = {first} | (causes.OF_THE_ARM if first in causes.OF_THE_ARM else set())
    return first, next(other for other in (name(index, salt) for salt in range(1, 99)) if other not in forbidden)


def build(arm, sensors, hidden, seen):
    """A body of an arm with hidden causes, and their parameters: a list of {joint index or None: {parameter: value}}."""
    body = plain_body(arm, sensors.step_rad, sensors.noise_rad, sensors.rise_k_nm2, sensors.warming_s)
    values = []
    for cause in hidden:
        law = (outside.OUTSIDE if cause.is_outside else causes.CATALOGUE)[cause.name]
        of_arm = cause.name in causes.OF_THE_ARM | outside.OF_THE_ARM
        each = {}
        for j in cause.joints:
            each[None if of_arm else j] = law(body, j, seen, cause.size, np.random.default_rng(cause.seed))
        values.append(each)
    return body, values


def controller_of(case_session, declared, body, recording):
    """What commanded a recording."""
    shape = case_session.shapes[recording]
    if case_session.is_closed:
        stiffness, damping = case_session.stiffness, case_session.damping
        return excitations.Follower(declared, shape, case_session.amplitude, stiffness, damping, body.gain_factor)
    return excitations.OpenLoop(shape, case_session.amplitude)


def record(declared, body, sensors, session, recording, rng, seconds=None, windows=8):
    """One recording of a body, with states kept for ``windows`` windows."""
    plant, controller = Plant(body), controller_of(session, declared, body, recording)
    lasts = session.seconds[recording] if seconds is None else min(seconds, session.seconds[recording])
    start = np.array(declared.home_rad) - body.offset_rad
    plant.start(start, np.zeros(declared.joints), np.zeros(declared.joints))
    every = max(1, round(lasts / session.period_s / windows))
    return run(plant, controller, lasts, session.period_s, rng, sensors.velocity_noise_rad_s, every)


def draw_session(rng, arm, names):
    """Rate, excitations, loop and columns of a case."""
    period = 1.0 / float(rng.choice(RATES_HZ))
    must_follow = not arm.hanging or "position_gain" in names
    is_closed = bool(must_follow or rng.random() < 0.45)
    only_targets = bool(is_closed and (rng.random() < 0.15 or "position_gain" in names))
    count = int(rng.integers(2, 4))
    kinds = (str(rng.choice(["sines", "chirp"])), *(str(k) for k in rng.choice(["sines", "chirp", "ramps", "steps"], count - 1)))
    seconds = tuple(float(round(s)) for s in rng.uniform(10, 40, count))
    top_hz = min(rng.uniform(1.2, 2.5) if is_closed else rng.uniform(2.0, 4.0), 0.02 / period)
    shapes = [excitations.draw_shape(rng, kind, arm.joints, s, top_hz) for kind, s in zip(kinds, seconds, strict=True)]
    shapes = tuple(excitations.faded(shape, s) for shape, s in zip(shapes, seconds, strict=True))
    most = (0.5, 1.1) if arm.joints < 7 else (0.3, 0.7)
    amplitude = rng.uniform(*most, arm.joints) if is_closed else rng.uniform(0.35, 0.8, arm.joints) * hanging_torque(arm)
    stiffness, damping = excitations.gains(arm, period)
    has_velocity = bool(only_targets or "velocity_filter" in names or rng.random() < 0.8)
    measured, warm = bool(not only_targets and rng.random() < 0.4), bool(rng.random() < 0.2)
    flags = (is_closed, only_targets, has_velocity, measured, warm)
    return Session(period, *flags, kinds, seconds, amplitude, shapes, stiffness, damping)


def draw_sensors(rng, arm):
    """Encoders of 14 to 19 bits a turn of the joint, sensors of speed and current, motors that warm by some tens of kelvin."""
    step = np.full(arm.joints, 2 * np.pi / 2 ** int(rng.integers(14, 20)))
    rise = rng.uniform(20, 60) / (0.1 * np.array(arm.torque_limit_nm)) ** 2
    speed, current = rng.uniform(0.002, 0.01), rng.uniform(0.003, 0.01)
    return Sensors(step, 0.3 * step, speed, current, rise, np.full(arm.joints, rng.uniform(60, 300)))


def calmed(rng, declared, sensors, session):
    """A session whose torques turn the declared arm by no more than 2 rad in its simulation, as its owner would see to."""
    for _ in range(12):
        body, _ = build(declared, sensors, (), None)
        traces = [record(declared, body, sensors, session, i, rng, seconds=10.0) for i in range(len(session.kinds))]
        if all(np.abs(trace.turned_rad).max() < 2.0 for trace in traces):
            return session
        session = replace(session, amplitude=session.amplitude * 0.75)
    raise ValueError("no amplitude keeps this arm within 2 rad")


def see(trace, session, arm):
    """What a pilot run showed."""

    def rms(values):
        return np.sqrt(np.mean(values**2, axis=0))

    torque, speed = trace.command_nm, trace.turned_rad_s
    spread = np.maximum(trace.turned_rad.std(axis=0), 0.02)
    mean, peak = trace.turned_rad.mean(axis=0), np.abs(torque).max(axis=0)
    moving = np.maximum(rms(speed), 0.05)
    return Seen(rms(torque), peak, moving, mean, spread, arm.inertia(), 1 / session.period_s)


def believed_commands(case, traces):
    """Commands as the owner computes them from targets and readings where nothing else was written down; else those sent."""
    if not case.session.only_targets:
        return [trace.command_nm for trace in traces]
    stiffness, damping = case.session.stiffness, case.session.damping
    return [stiffness * (x.target_rad - x.seen_rad) - damping * x.seen_rad_s + x.desired_nm for x in traces]


def visible(case, hidden, traces, i):
    """The visibility of cause ``i`` among ``hidden``, seen in ``traces``."""
    if visibility.is_of_readings(hidden[i].name):
        return visibility.of_readings(traces, case.sensors)
    others = hidden[:i] + hidden[i + 1 :]
    without, _ = build(case.true, case.sensors, others, case.seen)
    declared, _ = build(case.declared, case.sensors, others, case.seen)
    commands = believed_commands(case, traces) if hidden[i].name == "position_gain" else None
    return visibility.of_motion(traces, without, declared, case.sensors, case.session.period_s, commands)


MOST_ARMS = 10
"""That are drawn until one stays in its range."""


def has_failed(session, trace, seconds):
    """Whether an experimenter would have stopped: out of the range, or far from what was wanted."""
    if len(trace.time_s) < round(seconds / session.period_s) or not np.isfinite(trace.turned_rad).all():
        return True
    return session.is_closed and bool(np.abs(trace.turned_rad - trace.target_rad).max() > LARGEST_MISS_RAD)


def sized(rng, case, name):
    """A cause of a drawn size and joint that a pilot run shows: from ``LEAST_VISIBILITY`` to ``LARGEST_VISIBILITY``."""
    is_outside, n = case.kind == "outside", case.declared.joints
    of_arm = name in causes.OF_THE_ARM | outside.OF_THE_ARM
    places: list[tuple[int, ...]] = [(int(j),) for j in rng.permutation(n)]
    if of_arm:
        places = [(0,)]
    elif name in causes.MAYBE_EVERYWHERE and n > 1 and rng.random() < 0.3:
        places.insert(0, tuple(range(n)))
    first, seed, best = float(rng.uniform()), int(rng.integers(2**31)), None
    for joints in places:
        size, tried = first, set()
        while round(size, 3) not in tried and -0.5 <= size <= 1.2:
            tried.add(round(size, 3))
            cause = Cause(name, is_outside, joints, size, seed)
            body, _ = build(case.true, case.sensors, (cause,), case.seen)
            lasts = min(PILOT_S, case.session.seconds[0])
            trace = record(case.declared, body, case.sensors, case.session, 0, np.random.default_rng(seed), lasts)
            failed = has_failed(case.session, trace, lasts)
            cause = cause if failed else replace(cause, visibility=visible(case, (cause,), (trace,), 0))
            if not failed and LEAST_VISIBILITY <= cause.visibility <= LARGEST_VISIBILITY:
                return cause
            if not failed and (best is None or abs(np.log(cause.visibility + 1e-9)) < abs(np.log(best.visibility + 1e-9))):
                best = cause
            size += -0.2 if failed or cause.visibility > LARGEST_VISIBILITY else 0.2
    if best is None:
        raise NoSizeError(f"no size of {name} leaves this arm in its range")
    return best


class NoSizeError(ValueError):
    """An arm that leaves its range whatever size a cause has."""


def draw_case(seed, kind, index):
    """All of a case. The same three arguments give the same case, whatever else was made before."""
    rng, names = case_rng(seed, kind, index), names_of(seed, kind, index)
    for _ in range(MOST_ARMS):
        try:
            return drawn_case(rng, names, seed, kind, index)
        except NoSizeError as error:
            last = error
    raise last


def drawn_case(rng, names, seed, kind, index):
    """A case with some causes: arm, sensors, session and sizes are drawn.

    Raises:
        NoSizeError: the arm leaves its range whatever is hidden; another one is to be drawn.
    """
    lonely = set(names) & (outside.NEEDS_TWO_JOINTS | causes.NEEDS_NEIGHBOURS)
    joints = int(rng.choice([1, 2, 3, 7], p=[0.2, 0.3, 0.3, 0.2]))
    declared = draw_arm(rng, max(2, joints) if lonely else joints)
    true, sensors = shaken(rng, declared), draw_sensors(rng, declared)
    session = draw_session(rng, declared, names)
    session = session if session.is_closed else calmed(rng, declared, sensors, session)
    body, _ = build(true, sensors, (), None)
    pilot = record(declared, body, sensors, session, 0, rng, PILOT_S)
    case = Case(seed, kind, index, declared, true, sensors, session, (), see(pilot, session, declared))
    case = replace(case, causes=tuple(sized(rng, case, name) for name in names))
    return recorded(case, rng)


def recorded(case, rng):
    """The case with its full recordings; amplitudes shrink until no recording had to be stopped.

    Raises:
        NoSizeError: one had to be at the smallest; another arm is to be drawn.
    """
    for _ in range(8):
        body, _ = build(case.true, case.sensors, case.causes, case.seen)
        traces = []
        for i, seconds in enumerate(case.session.seconds):
            traces.append(record(case.declared, body, case.sensors, case.session, i, rng))
            if has_failed(case.session, traces[-1], seconds):
                break
        else:
            found = [visible(case, case.causes, traces, i) for i in range(len(case.causes))]
            hidden = tuple(replace(cause, visibility=value) for cause, value in zip(case.causes, found, strict=True))
            return replace(case, causes=hidden, traces=tuple(traces))
        case = replace(case, session=replace(case.session, amplitude=case.session.amplitude * 0.7))
    raise NoSizeError("no amplitude lets this arm be recorded to the end")
