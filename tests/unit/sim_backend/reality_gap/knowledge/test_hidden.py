"""What blind tests hide."""

from sim_backend.effects.catalogue import PARAMETERS
from sim_backend.reality_gap.knowledge.healthy import detection_limits
from sim_backend.reality_gap.knowledge.hidden import AT_JOINTS, BESIDE_CUBE, OF_CUBE
from sim_backend.reality_gap.knowledge.joint_effects import FITTED, SEEN


def test_every_effect_that_joints_show_is_hidden_and_has_a_detection_limit():
    asked = {*FITTED, *(key.partition(".")[0] for key in SEEN.values())}
    assert {hidden.effect for hidden in AT_JOINTS.values()} == asked
    assert set(AT_JOINTS) == set(detection_limits())


def test_everything_hidden_is_a_parameter():
    more = [key for hidden in AT_JOINTS.values() for key in (*dict(hidden.beside), *(hidden.drawn or ())[:1])]
    assert {*AT_JOINTS, *OF_CUBE.values(), *dict(BESIDE_CUBE), *more} <= set(PARAMETERS)
    for hidden in AT_JOINTS.values():
        if hidden.drawn is not None:
            key, low, high = hidden.drawn
            assert PARAMETERS[key].lower <= low < high <= PARAMETERS[key].upper
