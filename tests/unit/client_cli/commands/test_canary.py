import pytest

LINE = "expert: 20 trials of push every 0.5 h on each idle robot; out of service below 80 % (set by operator)\n"


@pytest.fixture
def weights(tmp_path):
    path = tmp_path / "expert.onnx"
    path.write_bytes(b"abc")
    return str(path)


def test_a_canary_is_set_shown_and_dropped(farm, trifarm, weights):
    flags = ("--task", "push", "--at-least", "0.8", "--trials", "20", "--every-h", "0.5", "--layout", "pose")
    assert trifarm("canary", "set", weights, *flags).out == LINE
    assert farm.uploads == ["expert.onnx"]
    assert trifarm("canary").out == LINE
    assert trifarm("canary", "--json").document["every_s"] == 1800
    assert trifarm("canary", "off", "--json").document == {"dropped": True}
    assert farm.canaries == []


@pytest.mark.parametrize("wrong", [("--at-least", "0"), ("--at-least", "0.5", "--every-h", "0.01")])
def test_a_band_or_time_that_cannot_be_is_refused_here(farm, trifarm, weights, wrong):
    assert trifarm("canary", "set", weights, "--task", "push", "--layout", "pose", *wrong).code == 2
    assert not farm.uploads
