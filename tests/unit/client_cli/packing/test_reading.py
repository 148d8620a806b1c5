"""What pack says of files that torch can read, or not, but that hold no policy by themselves."""

import pytest

import trifarm

torch = pytest.importorskip("torch")
NETWORK = {"architecture": "0,2", "activation": "tanh", "normaliser": "none"}


def actor():
    return torch.nn.Sequential(torch.nn.Linear(54, 16), torch.nn.Tanh(), torch.nn.Linear(16, 9))


def packed(tmp_path, content):
    torch.save(content, tmp_path / "actor.pt")
    return trifarm.pack(tmp_path / "actor.pt", tmp_path / "mine.safetensors", expects="rrc2022-push", **NETWORK)


def test_a_training_checkpoint_names_the_part_to_save(tmp_path):
    content = {"epoch": 3, "model": actor().state_dict(), "optimizer": {"state": {}}}
    with pytest.raises(trifarm.ClientError, match="holds epoch, model, optimizer; 'model' looks like the state_dict"):
        packed(tmp_path, content)


def test_a_state_dict_is_packed_with_a_note_on_what_it_does_not_show(tmp_path):
    notes = packed(tmp_path, actor().state_dict()).notes
    assert any('"squash": "tanh"' in note and "not with your program" in note for note in notes)
