"""What positions say of reported velocities: filters are told from columns that are late, and from what tables do."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from sim_backend.reality_gap.recording import JointSignals, Recording
from sim_backend.reality_gap.subjects.joints.laws.trajectory import trajectory
from sim_backend.reality_gap.subjects.joints.signs.position_and_velocity import causes_of_velocities, reported

FINE_S = 2.5e-4
SECONDS = 12.0


def turned():
    """Positions and velocities of a smooth motion in fine steps."""
    at = np.arange(0.0, SECONDS, FINE_S)
    waves = [(0.5, 1.9, 0.3), (0.3, 5.0, 1.0), (0.1, 11.0, 2.0)]
    position = sum(a * np.sin(w * at + p) for a, w, p in waves)
    return position, sum(a * w * np.cos(w * at + p) for a, w, p in waves)


def path_of(row_s, *, filter_s=0.0, late_s=0.0, mean_of_row=False):
    """A motion as it is read every ``row_s``."""
    rng, every = np.random.default_rng(3), round(row_s / FINE_S)
    position, velocity = turned()
    if filter_s:
        share = -np.expm1(-FINE_S / filter_s)
        velocity = lfilter([share], [1.0, share - 1.0], velocity, zi=[velocity[0] * (1.0 - share)])[0]
    late = round(late_s / FINE_S)
    velocity = np.concatenate([np.full(late, velocity[0]), velocity[: len(velocity) - late]])
    step = 2.0 * np.pi / 2**16
    q = np.round(position[::every] / step) * step
    v = np.diff(q, prepend=q[0]) / row_s if mean_of_row else velocity[::every]
    v = v + 0.004 * rng.standard_normal(len(v))
    at = row_s * np.arange(len(q))
    signals = JointSignals(("hinge",), q[:, None], velocity_rad_s=v[:, None], commanded_torque_nm=np.zeros((len(q), 1)))
    return trajectory(Recording("made", "here", row_s, at, signals), cutoff_hz=12.0)


def found(row_s, **of_velocity):
    """What is said of it."""
    return reported([path_of(row_s, **of_velocity)], 0)


@pytest.mark.parametrize(("row_s", "filter_s"), [(0.001, 0.004), (0.004, 0.012), (0.01, 0.03)])
def test_a_filter_is_told_with_its_time_constant(row_s, filter_s):
    said = found(row_s, filter_s=filter_s)
    assert said.is_filtered and said.filtered[0] == pytest.approx(filter_s, rel=0.1)


@pytest.mark.parametrize("row_s", [0.001, 0.01])
@pytest.mark.parametrize("mean_of_row", [False, True])
def test_what_a_table_does_is_no_filter(row_s, mean_of_row):
    assert not found(row_s, mean_of_row=mean_of_row).is_late


def test_a_column_that_is_written_a_row_later_is_as_tables_are():
    assert not found(0.004, late_s=0.004).is_late


def test_a_column_that_is_far_too_late_is_no_filter():
    said = found(0.002, late_s=0.012)
    assert said.is_late and not said.is_filtered and said.delayed[0] == pytest.approx(0.012, rel=0.1)


@pytest.mark.parametrize(("of_velocity", "is_named"), [({"filter_s": 0.012}, True), ({"late_s": 0.012}, False)])
def test_a_velocity_that_is_late_may_be_filtered(of_velocity, is_named):
    causes, perhaps, open_ = causes_of_velocities([SimpleNamespace(path=path_of(0.004, **of_velocity))], ("hinge",))
    (late,) = causes or perhaps
    assert (late.effect, late.where, late.unit) == ("velocity_filter", "hinge", "s")
    assert late.value == pytest.approx(0.012, rel=0.1)
    assert bool(causes) == is_named != bool(perhaps) == bool(open_)


@pytest.mark.parametrize("what", ["as it is", "noisy", "turned", "deg/s", "another's"])
def test_a_velocity_of_something_else_is_said_and_is_no_filter(what):
    path = path_of(0.004)
    own = path.joints.velocity_rad_s
    assert own is not None
    at, rng = path.recording.time_s, np.random.default_rng(4)
    told = {
        "as it is": own,
        "noisy": own + 3.0 * rng.standard_normal(own.shape),
        "turned": -own,
        "deg/s": np.degrees(own),
        "another's": np.sin(3.1 * at)[:, None] + np.cos(7.7 * at)[:, None],
    }[what]
    recording = replace(path.recording, joints=replace(path.joints, velocity_rad_s=told))
    causes, perhaps, open_ = causes_of_velocities([SimpleNamespace(path=trajectory(recording, cutoff_hz=12.0))], ("hinge",))
    assert not causes and not perhaps
    assert bool(open_) == (what in ("turned", "deg/s", "another's"))
    assert all(said.startswith("what the velocity of hinge is: ") and "check its column" in said for said in open_)
