"""What ``trifarm.pack`` and ``trifarm.check`` say, in the words of Python."""

from pathlib import Path

import numpy as np
import pytest
import safetensors.numpy

import trifarm
from api_schemas.policy import LAYOUTS

PUSH = Path(trifarm.__file__).parents[1] / "sim_backend/training/reference_policies/push.safetensors"


@pytest.mark.parametrize(
    ("given", "said"),
    [({"form": "keras"}, "form keras is not known"), ({"activation": "gelu6"}, "activation gelu6 is not known")],
)
def test_refusals_name_arguments_and_not_options(tmp_path, given, said):
    checkpoint = tmp_path / "actor.pt"
    checkpoint.write_bytes(b"weights")
    with pytest.raises(trifarm.ClientError, match=said) as refused:
        trifarm.pack(checkpoint, tmp_path / "mine.safetensors", expects="rrc2022-push", **given)
    assert "--" not in refused.value.detail


def test_a_check_tries_a_policy_and_warns_as_the_command_does(tmp_path):
    """A network that nothing comes of: the farm's checks take it, and the trials show it."""
    size = LAYOUTS["push"].observation_size
    weights = np.random.default_rng(0).normal(0.0, 1e-4, (9, size)).astype(np.float32)
    idle = tmp_path / "idle.safetensors"
    idle.write_bytes(safetensors.numpy.save({"layer0.weight": weights, "layer0.bias": np.zeros(9, np.float32)}))
    alone = trifarm.check(idle, expects="push", tries=False)
    tried = trifarm.check(idle, expects="push")
    assert alone.accepted and tried.accepted
    assert tried.warnings[: len(alone.warnings)] == alone.warnings
    assert len(tried.warnings) > len(alone.warnings)


def test_a_check_says_of_a_file_that_no_farm_takes_what_to_do(tmp_path):
    pickled = tmp_path / "policy.pth"
    pickled.write_bytes(b"weights")
    said = trifarm.check(pickled)
    assert not said.accepted and said.problem is not None and "trifarm pack policy.pth" in said.problem.detail
    with pytest.raises(trifarm.ClientError, match="'dance' for a policy"):
        trifarm.check(PUSH, task="dance")
