"""A filter of the velocity in a loop whose torques nobody recorded is not named as a lighter rotor, too."""

from dataclasses import replace

import numpy as np
import pytest

from sim_backend.reality_gap.subjects.joints.verdicts.filtered_loops import without_loops_of_filters
from sim_backend.reality_gap.verdict import Cause, EffectJudged, Told, Verdict, VerdictKind

NAMES, INERTIA_KG_M2, DAMPING, FILTER_S = ("near", "far"), np.array([0.02, 0.012]), np.array([np.nan, 1.5]), 0.006
FILTER = Cause("velocity_filter", "time_constant_s", "far", FILTER_S, "s", (0.0054, 0.0066))
LIGHTER = Cause("rotor_inertia", "armature_kg_m2", "far", 0.0029, "kg m^2", (0.0018, 0.004))
FRICTION = Cause("coulomb_friction", "torque_nm", "near", 0.1, "N m", (0.08, 0.12))


def named(*causes: Cause) -> Verdict:
    effects = tuple(EffectJudged(cause.effect, Told.NAMED) for cause in causes)
    return Verdict(VerdictKind.NAMED, "The robot goes where …", causes, effects=effects)


def without(verdict: Verdict, *filters: Cause) -> Verdict:
    return without_loops_of_filters(verdict, filters, NAMES, INERTIA_KG_M2, DAMPING)


@pytest.mark.parametrize("kind", [VerdictKind.NAMED, VerdictKind.CONFUSABLE])
def test_the_inertia_that_a_filter_has_instead_is_no_cause(kind):
    found = without(replace(named(LIGHTER), verdict=kind), FILTER)
    assert found.verdict is VerdictKind.NOTHING_WRONG and not found.causes and "velocity is as late" in found.summary
    assert [each.told for each in found.effects] == [Told.NOT_JUDGED]
    assert found.cannot_tell[0].startswith("whether there is rotor inertia (far)")


def test_other_causes_stay():
    found = without(named(FRICTION, LIGHTER), FILTER)
    assert found.verdict is VerdictKind.NAMED and found.causes == (FRICTION,)
    assert "What looks like rotor inertia at far is the late velocity" in found.summary
    assert [each.told for each in found.effects] == [Told.NAMED, Told.NOT_JUDGED]


@pytest.mark.parametrize(
    ("verdict", "filters"),
    [
        (named(LIGHTER), ()),
        (named(LIGHTER), (replace(FILTER, where="near"),)),
        (named(replace(LIGHTER, where="near")), (replace(FILTER, where="near"),)),
        (named(replace(LIGHTER, value=0.02, interval_90=(0.019, 0.021))), (FILTER,)),
        (named(FRICTION), (FILTER,)),
    ],
    ids=["no filter", "filter elsewhere", "torques are recorded", "a heavier rotor", "no inertia"],
)
def test_what_a_filter_does_not_explain_stays_as_it_is(verdict, filters):
    assert without(verdict, *filters) == verdict
