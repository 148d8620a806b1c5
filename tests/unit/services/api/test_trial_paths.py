"""The routes of one trial take every trial that a job may have, and no other."""

import pytest
from pydantic import TypeAdapter, ValidationError

from api_schemas import share
from api_schemas.job import MAX_TRIALS
from services.api.trials import TrialId
from services.api.truth import Ordinal


def test_the_last_trial_of_the_largest_job_can_be_asked_for():
    assert TypeAdapter(Ordinal).validate_python(str(MAX_TRIALS - 1)) == MAX_TRIALS - 1
    with pytest.raises(ValidationError):
        TypeAdapter(Ordinal).validate_python(str(MAX_TRIALS))
    name = f"j{'a' * 12}-{MAX_TRIALS - 1:03d}"
    for each in (TrialId, share.TrialId):
        assert TypeAdapter(each).validate_python(name) == name
        with pytest.raises(ValidationError):
            TypeAdapter(each).validate_python(f"j{'a' * 12}-{MAX_TRIALS:03d}")
