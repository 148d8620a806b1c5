"""What ``trifarm.pack`` refuses, in the words of Python."""

import pytest

import trifarm


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
