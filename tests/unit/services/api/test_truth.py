import pytest

from api_schemas.token import Scope
from api_schemas.verification import Verification
from services.api.tokens import Caller
from services.api.truth import shown_to

DIFFERENT = Verification(
    trial_id="j-000",
    steps=9,
    same=False,
    first_difference_step=3,
    largest_joint_difference_rad=0.5,
    largest_cube_difference_m=0.25,
)


@pytest.mark.parametrize(("scope", "told"), [(Scope.SUBMIT, False), (Scope.OPERATE, True), (Scope.ADMIN, True)])
def test_only_operators_are_told_how_large_a_difference_is(scope, told):
    shown = shown_to(Caller("t", "ann", frozenset({scope})), DIFFERENT)
    assert (shown.same, shown.first_difference_step) == (False, 3)
    assert (shown.largest_joint_difference_rad, shown.largest_cube_difference_m) == ((0.5, 0.25) if told else (None, None))
