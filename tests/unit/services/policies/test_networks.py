"""Graphs made of safetensors and ONNX against the same network in torch: memory, stacks of observations, heads."""

import io
import itertools
import warnings

import numpy as np
import onnxruntime
import pytest
import torch
from torch import nn

from api_schemas.policy import InputScaling, OutputScaling, PolicyManifest
from api_schemas.policy_graph import GraphRunner
from api_schemas.policy_network import FrameStack, NetworkState
from services.policies import graph, uploaded
from services.policies.unfit import UnfitError

SIZE = 18
FIELDS = ("joint_position_rad", "joint_velocity_rad_s")
STEPS = 200
OBSERVATIONS = np.random.default_rng(0).normal(size=(STEPS, SIZE)).astype(np.float32)


def runner(model):
    return GraphRunner(onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"]))


def actions(model, observations=OBSERVATIONS):
    policy = runner(model)
    return np.concatenate([policy.act(row[None]) for row in observations])


def manifest(**changes):
    return PolicyManifest(observation=FIELDS, **changes)


def linears(kind, *sizes, seed=0):
    """Layers of random weights by the names of a safetensors file."""
    torch.manual_seed(seed)
    layers = [nn.Linear(a, b) for a, b in itertools.pairwise(sizes)]
    parts = [(f"{kind}{i}.{name}", value) for i, layer in enumerate(layers) for name, value in layer.state_dict().items()]
    return layers, {name: value.numpy() for name, value in parts}


def cells(kind, takes, size, count):
    torch.manual_seed(1)
    module = {"lstm": nn.LSTM, "gru": nn.GRU}[kind](takes, size, count)
    return module, {f"recurrent.{name}": value.numpy() for name, value in module.state_dict().items()}


def run_torch(observations, encoder, module, norm, layers):
    """The whole trial as one sequence; torch keeps the memory."""
    x = torch.from_numpy(observations)
    with torch.no_grad():
        for layer in encoder:
            x = nn.functional.elu(layer(x))
        if module is not None:
            x = module(x[:, None])[0][:, 0]
        x = x if norm is None else norm(x)
        for index, layer in enumerate(layers):
            x = layer(x) if index == len(layers) - 1 else nn.functional.elu(layer(x))
    return x.numpy()


@pytest.mark.parametrize("kind", ["lstm", "gru"])
@pytest.mark.parametrize(("with_encoder", "with_norm", "count"), [(False, False, 1), (True, True, 2)])
def test_memory_is_that_of_torch(kind, with_encoder, with_norm, count):
    encoder, tensors = linears("encoder", SIZE, 24) if with_encoder else ([], {})
    module, more = cells(kind, 24 if with_encoder else SIZE, 32, count)
    norm = nn.LayerNorm(32) if with_norm else None
    layers, last = linears("layer", 32, 16, 9, seed=3)
    tensors |= more | last
    if norm is not None:
        nn.init.normal_(norm.weight)
        tensors |= {f"recurrent_norm.{name}": value.numpy() for name, value in norm.state_dict().items()}
    given = actions(graph.from_tensors(tensors, manifest(recurrent=kind)))
    wanted = run_torch(OBSERVATIONS, encoder, module, norm, layers)
    assert np.abs(given - wanted).max() <= 1e-5
    # And it is memory: the same observation after others gives something else.
    assert np.abs(given[-1] - actions(graph.from_tensors(tensors, manifest(recurrent=kind)), OBSERVATIONS[-1:])[0]).max() > 1e-3


def test_a_new_trial_begins_with_nothing():
    _, tensors = cells("lstm", SIZE, 8, 1)
    policy = runner(graph.from_tensors(tensors | linears("layer", 8, 9)[1], manifest(recurrent="lstm")))
    first = [policy.act(row[None]) for row in OBSERVATIONS[:5]]
    policy.forget()
    np.testing.assert_array_equal(first, [policy.act(row[None]) for row in OBSERVATIONS[:5]])


def stacked_by_hand(fill, order, count):
    start = np.repeat(OBSERVATIONS[:1], count - 1, 0) if fill == "first" else np.zeros((count - 1, SIZE), np.float32)
    rows = np.concatenate([start, OBSERVATIONS])
    frames = [rows[i : i + STEPS] for i in range(count)]
    return np.concatenate(frames if order == "oldest_first" else frames[::-1], axis=1)


@pytest.mark.parametrize("fill", ["first", "zeros"])
@pytest.mark.parametrize("order", ["oldest_first", "newest_first"])
def test_observations_are_stacked(fill, order):
    layers, tensors = linears("layer", SIZE * 4, 16, 9)
    stack = FrameStack(count=4, fill=fill, order=order)
    given = actions(graph.from_tensors(tensors, manifest(frame_stack=stack)))
    assert np.abs(given - run_torch(stacked_by_hand(fill, order, 4), [], None, None, layers)).max() <= 1e-5


@pytest.mark.parametrize("whole", [False, True])
def test_scaling_comes_before_or_after_stacking_by_its_length(whole):
    layers, tensors = linears("layer", SIZE * 2, 9)
    count = 2 if whole else 1
    scaling = InputScaling(mean=(1.0,) * SIZE * count, variance=(4.0,) * SIZE * count, epsilon=1e-12)
    asked = manifest(frame_stack=FrameStack(count=2, fill="zeros"), input_scaling=scaling)
    rows = stacked_by_hand("zeros", "oldest_first", 2)
    scaled = (rows - 1) / 2
    if not whole:
        scaled[0, :SIZE] = 0  # what was never observed is zero after scaling
    given = actions(graph.from_tensors(tensors, asked))
    assert np.abs(given - run_torch(scaled, [], None, None, layers)).max() <= 1e-5


def test_the_mean_of_a_gaussian_and_a_squashed_output():
    layers, tensors = linears("layer", SIZE, 18)
    scaled = OutputScaling(squash="tanh", scale=0.3, offset=(0.1,) * 9)
    given = actions(graph.from_tensors(tensors, manifest(head="gaussian", output_scaling=scaled)))
    wanted = np.tanh(run_torch(OBSERVATIONS, [], None, None, layers)[:, :9]) * 0.3 + 0.1
    assert np.abs(given - wanted).max() <= 1e-6


def test_bins_are_their_centres():
    layers, tensors = linears("layer", SIZE, 99)
    given = actions(graph.from_tensors(tensors, manifest(head="bins", bins=11, output_scaling=OutputScaling(scale=0.36))))
    preferred = run_torch(OBSERVATIONS, [], None, None, layers).reshape(-1, 9, 11).argmax(2)
    np.testing.assert_allclose(given, (-1 + 0.2 * preferred) * 0.36, atol=1e-6)
    assert len(np.unique(preferred)) == 11


class TorchLstm(nn.Module):
    def __init__(self):
        super().__init__()
        self.memory, self.last = nn.LSTM(SIZE * 2, 16), nn.Linear(16, 9)

    def forward(self, x, h, c):
        y, (h, c) = self.memory(x[None], (h, c))
        return self.last(y[0]), h, c


STATES = tuple(NetworkState(input=name, output=f"{name}_next", shape=(1, 1, 16)) for name in ("h", "c"))


def exported():
    torch.manual_seed(5)
    module, file = TorchLstm(), io.BytesIO()
    zero = torch.zeros(1, 1, 16)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        names = {"input_names": ["x", "h", "c"], "output_names": ["a", "h_next", "c_next"]}
        torch.onnx.export(torch.jit.script(module), (torch.zeros(1, SIZE * 2), zero, zero), file, dynamo=False, **names)
    return module, file.getvalue()


def test_an_uploaded_graph_keeps_the_states_that_its_manifest_declares():
    module, content = exported()
    asked = manifest(states=STATES, frame_stack=FrameStack(count=2))
    given = actions(graph.around(uploaded.parse(content, asked), asked))
    wanted = run_torch(stacked_by_hand("first", "oldest_first", 2), [], module.memory, None, [module.last])
    assert np.abs(given - wanted).max() <= 1e-5


@pytest.mark.parametrize(
    ("states", "words"),
    [
        ((), "3 inputs and 3 outputs beside the manifest's states"),
        ((STATES[0],), "2 inputs and 2 outputs"),
        ((STATES[0].model_copy(update={"input": "g"}),), "'g' is no input of the graph; it has x, h, c"),
        ((STATES[0].model_copy(update={"shape": (1, 1, 8)}), STATES[1]), "has shape"),
    ],
)
def test_states_that_the_graph_does_not_have_are_refused(states, words):
    _, content = exported()
    with pytest.raises(UnfitError, match=words):
        uploaded.parse(content, manifest(states=states, frame_stack=FrameStack(count=2)))


@pytest.mark.parametrize(
    ("change", "asked", "words"),
    [
        ({}, {}, "a file with memory needs recurrent in its manifest"),
        ({}, {"recurrent": "gru"}, "recurrent layer 0 has shapes"),
        ({"recurrent.bias_hh_l0": None}, {"recurrent": "lstm"}, "missing: recurrent.bias_hh_l0"),
        ({"layer0.weight": np.zeros((9, 7), np.float32)}, {"recurrent": "lstm"}, "the memory gives 8"),
        ({}, {"recurrent": "lstm", "frame_stack": {"count": 2}}, "stacked 2 times 36"),
        ({}, {"recurrent": "lstm", "head": "gaussian"}, "needs 18"),
        ({"recurrent.weight_ih_l0": np.full((32, SIZE), np.nan)}, {"recurrent": "lstm"}, "not finite"),
    ],
)
def test_memory_that_does_not_fit_is_refused(change, asked, words):
    tensors = cells("lstm", SIZE, 8, 1)[1] | linears("layer", 8, 9)[1] | change
    tensors = {name: value for name, value in tensors.items() if value is not None}
    with pytest.raises(UnfitError, match=words):
        graph.from_tensors(tensors, PolicyManifest.model_validate({"observation": FIELDS} | asked))
