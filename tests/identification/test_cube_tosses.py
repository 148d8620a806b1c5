"""Causes hidden in tosses are found, nothing is found where nothing is, and the published cube gives friction and scale."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from sim_backend.reality_gap.recording import ObjectSignals, Recording
from sim_backend.reality_gap.subjects.tosses.study import study_object
from sim_backend.reality_gap.verdict import VerdictKind, names_of
from tests.unit.sim_backend.reality_gap.subjects.tosses.simulated_tosses import toss_spec, tosses

_ROOT = Path(__file__).parents[2]
_TOSSES = _ROOT.parent / "shared/data/contactnets_cube/tosses.npz"
_MODEL = _ROOT / "docs/studies/cube-tosses/model.xml"


def _study(spec, recordings, nominal, seed):
    return study_object(spec, recordings, nominal, np.random.default_rng(seed), lambda *_: None)


def _value(study, effect: str):
    return next(cause for cause in study.causes if cause.effect == effect)


def _published(every: int) -> list[Recording]:
    with np.load(_TOSSES) as file:
        data = {name: file[name] for name in ("toss", "t", "pos", "quat_wxyz")}
    out = []
    for toss in np.unique(data["toss"])[::every]:
        rows = data["toss"] == toss
        time_s = data["t"][rows]
        pose = ObjectSignals("cube", "cube", time_s, data["pos"][rows], data["quat_wxyz"][rows])
        out.append(Recording(f"toss {toss}", _TOSSES.name, float(np.median(np.diff(time_s))), time_s, None, (pose,)))
    return out


@pytest.mark.skipif(not _TOSSES.exists(), reason="the published tosses are not on this machine")
def test_published_cube_gives_friction_and_the_scale_of_its_measurement():
    study = _study(mujoco.MjSpec.from_file(str(_MODEL)), _published(60), {"table_friction.coefficient": 1.0}, 1)
    assert study.kind is VerdictKind.NAMED
    assert {("table_friction", "table"), ("tracking_scale", "camera")} <= names_of(study.causes)
    assert _value(study, "table_friction").value == pytest.approx(0.18, abs=0.02)
    assert _value(study, "tracking_scale").value == pytest.approx(-0.02, abs=0.006)
    (size,) = (one for one in study.lost if one.rival.effect == "cube_size")
    assert (size.cause, size.rival.separated_by) == ("tracking_scale", "acceleration in free flight")
    assert any(sentence.startswith("cube_size.factor: not identifiable from the motion alone") for sentence in study.cannot_tell)
    assert any(sentence.startswith("cube_mass: not identifiable") for sentence in study.cannot_tell)
    assert study.confirmation is not None
    assert study.confirmation.held_out.after < 0.25 * study.confirmation.held_out.before


@pytest.mark.parametrize(
    ("hidden", "scale", "effect", "value", "tolerance"),
    [
        pytest.param({"friction": 0.15}, 1.0, "table_friction", 0.15, 0.02, marks=pytest.mark.scale),
        pytest.param({}, 0.97, "tracking_scale", -0.03, 0.006, marks=pytest.mark.scale),
    ],
)
def test_hidden_cause_is_named(hidden, scale, effect, value, tolerance):
    """`test_published_cube_gives_friction_and_the_scale_of_its_measurement` names a friction and a
    scale without scale, and `test_a_size_that_only_the_height_at_rest_shows_is_confusable_with_the_table_s_height` a hidden size.
    """
    study = _study(toss_spec(), tosses(toss_spec(**hidden), 12, 11, scale=scale), {}, 11)
    assert study.causes[0].effect == effect
    if len(study.causes) > 1:  # twelve tosses may not be enough to tell it from its rivals, which then stand beside it
        assert study.kind is VerdictKind.CONFUSABLE
        assert study.cannot_tell[0].startswith(f"{effect} or ")
    assert _value(study, effect).value == pytest.approx(value, abs=tolerance)


def test_a_size_that_only_the_height_at_rest_shows_is_confusable_with_the_table_s_height():
    study = _study(toss_spec(), tosses(toss_spec(half_m=(0.0485,) * 3), 12, 31), {}, 31)
    assert study.kind is VerdictKind.CONFUSABLE
    assert {cause.effect for cause in study.causes} == {"cube_size", "tracking_offset"}
    assert _value(study, "cube_size").value == pytest.approx(0.97, abs=0.01)
    assert any("caliper" in advice or "two levels" in advice for advice in study.record_next)


@pytest.mark.parametrize("seed", [21, pytest.param(22, marks=pytest.mark.scale)])
def test_nothing_is_named_where_nothing_is_wrong(seed):
    """`test_nothing_is_named_where_nothing_is_wrong` has one session without scale."""
    study = _study(toss_spec(), tosses(toss_spec(), 12, seed), {}, seed)
    assert study.kind is VerdictKind.NOTHING_WRONG
    assert study.causes == ()
