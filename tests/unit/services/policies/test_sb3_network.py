"""Archives that stable-baselines3 wrote itself compute what its own predict() gives."""

import numpy as np
import onnxruntime
import pytest

from api_schemas.policy import LAYOUTS, MAX_WEIGHTS_BYTES, InputScaling, OutputScaling, PolicyManifest, WeightsFormat
from api_schemas.policy_graph import GraphRunner
from services.policies import graph, sb3_network
from services.policies.intake import check_weights
from services.policies.sb3_archive import Settings
from services.policies.torch_file import read_tensors
from services.policies.unfit import UnfitError
from tests.hostile.valid import SB3_NAMES, sb3_entries, torch_file, weights, zipped

gym = pytest.importorskip("gymnasium")
sb3 = pytest.importorskip("stable_baselines3")
torch = pytest.importorskip("torch")

LAYOUT = LAYOUTS["rrc2022-push"]
SIZE = LAYOUT.observation_size
LOW, HIGH = -np.linspace(0.1, 0.5, 9, dtype=np.float32), np.linspace(0.2, 0.36, 9, dtype=np.float32)
TORQUES = PolicyManifest(observation=LAYOUT.observation)
"""The action space is that of torques already, so that the manifest has nothing to scale."""


class Arm(gym.Env):
    observation_space = gym.spaces.Box(-np.inf, np.inf, (SIZE,), np.float32)
    action_space = gym.spaces.Box(LOW, HIGH, (9,), np.float32)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        return self.seen(), {}

    def step(self, action):
        return self.seen(), -float(np.sum(action**2)), False, bool(self.np_random.random() < 0.1), {}

    def seen(self):
        return self.np_random.normal(0, 2, SIZE).astype(np.float32)


OFF_POLICY = {"learning_starts": 10, "batch_size": 16, "buffer_size": 200}
TRAINED = {
    "PPO": ("PPO", {"n_steps": 64, "n_epochs": 2}),
    "PPO with ELU and layers of its own": (
        "PPO",
        {"n_steps": 64, "policy_kwargs": {"activation_fn": torch.nn.ELU, "net_arch": {"pi": [24, 16, 8], "vf": [8]}}},
    ),
    "PPO without hidden layers": ("PPO", {"n_steps": 64, "policy_kwargs": {"net_arch": []}}),
    "PPO squashed": ("PPO", {"n_steps": 64, "use_sde": True, "policy_kwargs": {"squash_output": True}}),
    "A2C": ("A2C", {}),
    "A2C with gSDE": ("A2C", {"use_sde": True}),
    "SAC": ("SAC", OFF_POLICY),
    "SAC with gSDE": ("SAC", OFF_POLICY | {"use_sde": True}),
    "TD3": ("TD3", OFF_POLICY | {"policy_kwargs": {"net_arch": [32, 16]}}),
    "DDPG": ("DDPG", OFF_POLICY | {"policy_kwargs": {"activation_fn": torch.nn.LeakyReLU}}),
}  # fmt: skip


def trained(name, env=None):
    torch.set_num_threads(1)
    algorithm, arguments = TRAINED[name]
    model = getattr(sb3, algorithm)("MlpPolicy", env or Arm(), seed=1, device="cpu", **arguments)
    return model.learn(64 if algorithm in ("PPO", "A2C") else 20)


def converted(path, manifest):
    """The graph that robots run, made the way the server does it."""
    check_weights(path, WeightsFormat.ZIP, MAX_WEIGHTS_BYTES)
    inner = sb3_network.read_archive(memoryview(path.read_bytes()), MAX_WEIGHTS_BYTES, manifest)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    return onnxruntime.InferenceSession(graph.around(inner, manifest).SerializeToString(), options)


def actions(session, observations):
    return np.concatenate([session.run(["action"], {"observation": each[None]})[0] for each in observations])


@pytest.mark.parametrize("name", TRAINED)
def test_round_trip(name, tmp_path):
    model, path = trained(name), tmp_path / "model.zip"
    model.save(path)
    observations = np.random.default_rng(0).normal(0, 3, (1000, SIZE)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    given = actions(converted(path, TORQUES), observations)
    assert np.ptp(expected, axis=0).max() > 1e-2
    assert np.abs(given - expected).max() <= 1e-5


def test_normalised_observations_and_scaled_actions_are_stated_by_the_manifest(tmp_path):
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    seen = VecNormalize(DummyVecEnv([Arm]), clip_obs=2.0)
    model, path = trained("PPO", seen), tmp_path / "model.zip"
    model.save(path)
    statistics = seen.obs_rms
    scaling = InputScaling(
        mean=tuple(statistics.mean.tolist()), variance=tuple(statistics.var.tolist()), epsilon=seen.epsilon, clip=seen.clip_obs
    )
    manifest = TORQUES.model_copy(update={"input_scaling": scaling, "output_scaling": OutputScaling(clip=0.3, scale=1.1)})
    observations = np.random.default_rng(0).normal(0, 3, (1000, SIZE)).astype(np.float32)
    expected, _ = model.predict(seen.normalize_obs(observations), deterministic=True)
    given = actions(converted(path, manifest), observations)
    assert np.abs(given - np.clip(expected, -0.3, 0.3) * np.float32(1.1)).max() <= 1e-5


class Recurrent(torch.nn.Module):
    """The actor of sb3-contrib's RecurrentPPO, with its names, beside a part of the critic."""

    def __init__(self, layers):
        super().__init__()
        self.lstm_actor = torch.nn.LSTM(SIZE, 16, num_layers=layers)
        self.lstm_critic = torch.nn.LSTM(SIZE, 16)
        hidden = torch.nn.Sequential(torch.nn.Linear(16, 12), torch.nn.Tanh(), torch.nn.Linear(12, 8), torch.nn.Tanh())
        self.mlp_extractor = torch.nn.ModuleDict({"policy_net": hidden})
        self.action_net = torch.nn.Linear(8, 9)

    def trial(self, observations):
        """The actions of a trial, from a memory of zeros."""
        remembered, _ = self.lstm_actor(observations[:, None])
        return self.action_net(self.mlp_extractor["policy_net"](remembered[:, 0])).clip(-1, 1)


@pytest.mark.parametrize("layers", [1, 2])
def test_a_recurrent_policy_remembers_within_a_trial_and_forgets_between(layers, tmp_path):
    torch.manual_seed(0)
    actor = Recurrent(layers)
    with torch.no_grad():
        actor.action_net.weight *= 5
    torch.save(actor.state_dict(), tmp_path / "policy.pth")
    path = tmp_path / "model.zip"
    path.write_bytes(zipped(sb3_entries() | {"policy.pth": (tmp_path / "policy.pth").read_bytes()}))
    runner = GraphRunner(converted(path, TORQUES))
    observations = torch.randn(2, 500, SIZE)
    memoryless = 0.0
    for trial in observations:
        runner.forget()
        given = np.concatenate([runner.act(each[None].numpy()) for each in trial])
        with torch.no_grad():
            assert np.abs(given - actor.trial(trial).numpy()).max() <= 1e-5
            memoryless = max(memoryless, np.abs(given[1] - actor.trial(trial[1:2]).numpy()).max())
    assert memoryless > 1e-3


@pytest.mark.parametrize("algorithm", ["PPO", "A2C"])
def test_bins_of_a_multi_discrete_space_become_their_centres(algorithm, tmp_path):
    class Dactyl(Arm):
        action_space = gym.spaces.MultiDiscrete([11] * 9)

    torch.set_num_threads(1)
    model, path = getattr(sb3, algorithm)("MlpPolicy", Dactyl(), seed=1, device="cpu", n_steps=64).learn(64), tmp_path / "m.zip"
    model.save(path)
    observations = np.random.default_rng(0).normal(0, 3, (1000, SIZE)).astype(np.float32)
    expected, _ = model.predict(observations, deterministic=True)
    manifest = PolicyManifest(observation=LAYOUT.observation, output_scaling=OutputScaling(scale=0.36))
    given = actions(converted(path, manifest), observations)
    assert len(np.unique(expected)) == 11
    assert np.abs(given - (expected / 5 - 1) * 0.36).max() <= 1e-5


def test_bins_that_are_not_nine_times_the_same_are_refused():
    for bins in ((11,) * 8, (11,) * 8 + (10,), (1,) * 9, (10**9,) * 9):
        settings = Settings(None, squashed=False, low=None, high=None, mean_clip=2.0, bins=bins)
        with pytest.raises(UnfitError, match="9 times the same number"):
            sb3_network.rebuilt(named(), settings, LAYOUT)


def test_an_archive_of_recurrent_ppo_remembers_as_sb3_contrib_does(tmp_path):
    contrib = pytest.importorskip("sb3_contrib", reason="sb3-contrib is not installed")
    torch.set_num_threads(1)
    settings = {"n_steps": 32, "batch_size": 32, "learning_rate": 1e-2, "policy_kwargs": {"lstm_hidden_size": 16}}
    model, path = contrib.RecurrentPPO("MlpLstmPolicy", Arm(), seed=1, device="cpu", **settings).learn(64), tmp_path / "m.zip"
    model.save(path)
    runner = GraphRunner(converted(path, TORQUES))
    for trial in np.random.default_rng(0).normal(0, 2, (2, 100, SIZE)).astype(np.float32):
        runner.forget()
        state, begins, memoryless = None, np.array([True]), 0.0
        for row in trial:
            expected, state = model.predict(row, state, begins, deterministic=True)
            assert np.abs(runner.act(row[None])[0] - expected).max() <= 1e-5
            memoryless = max(memoryless, np.abs(model.predict(row, deterministic=True)[0] - expected).max())
            begins = np.array([False])
        assert memoryless > 1e-3


def test_an_archive_with_a_manifest_of_another_kind_of_network_is_refused():
    for change in ({"recurrent": "lstm"}, {"head": "bins", "bins": 11}):
        manifest = PolicyManifest(observation=LAYOUT.observation, **change)
        with pytest.raises(UnfitError, match=r"an archive says itself|'bins' needs 99"):
            sb3_network.rebuilt(named(), SETTINGS, manifest)


def test_an_archive_trained_on_stacked_frames_takes_a_manifest_with_the_stack(tmp_path):
    manifest = PolicyManifest(observation=("joint_position_rad", "joint_velocity_rad_s"), frame_stack={"count": 3})
    path = tmp_path / "model.zip"
    path.write_bytes(zipped(sb3_entries()))
    runner = GraphRunner(converted(path, manifest))
    runner.forget()
    assert runner.act(np.zeros((1, 18), np.float32)).shape == (1, 9)


@pytest.mark.parametrize("kind", [torch.float16, torch.float32, torch.float64])
def test_torch_files_are_read_as_torch_does(kind, tmp_path):
    tensors = {
        "plain": torch.randn(5, 3, dtype=kind),
        "transposed": torch.randn(4, 6, dtype=kind).T,
        "part": torch.randn(10, dtype=kind)[3:7],
        "scalar": torch.tensor(2.5, dtype=kind),
    }
    torch.save(tensors, tmp_path / "t.pth")
    read = read_tensors(memoryview((tmp_path / "t.pth").read_bytes()), MAX_WEIGHTS_BYTES, lambda _: True)
    assert set(read) == set(tensors)
    for name, tensor in tensors.items():
        assert np.array_equal(read[name], tensor.numpy())


def test_names_of_one_storage_count_each(tmp_path):
    """As many names as one likes may share the numbers of one storage."""
    shared = torch.zeros(1000)
    torch.save({f"layer{index}": shared for index in range(20)}, tmp_path / "t.pth")
    content = memoryview((tmp_path / "t.pth").read_bytes())
    assert len(content) < 20_000
    assert len(read_tensors(content, 80_000, lambda _: True)) == 20
    with pytest.raises(UnfitError, match="its tensors have 80000 bytes together; at most 79999 are taken") as refusal:
        read_tensors(content, 79_999, lambda _: True)
    assert refusal.value.slug == "archive-too-large"
    assert len(read_tensors(content, 79_999, lambda name: name != "layer0")) == 19


def test_the_small_torch_file_of_the_tests_is_one_for_torch(tmp_path):
    tensors = dict(zip(SB3_NAMES, weights(), strict=True))
    (tmp_path / "t.pth").write_bytes(torch_file(tensors))
    loaded = torch.load(tmp_path / "t.pth", weights_only=True)
    assert all(np.array_equal(loaded[name].numpy(), array) for name, array in tensors.items())


SETTINGS = Settings(None, squashed=False, low=(-1.0,) * 9, high=(1.0,) * 9, mean_clip=2.0)


def named(**changes):
    tensors = dict(zip(SB3_NAMES, weights(), strict=True)) | {name.replace("__", "."): each for name, each in changes.items()}
    return {name: each for name, each in tensors.items() if each is not None}


@pytest.mark.parametrize(
    ("changes", "settings", "says"),
    [
        ({"action_net__weight": None}, SETTINGS, "no policy of PPO"),
        ({"action_net__bias": None}, SETTINGS, "no such tensor"),
        ({"action_net__bias": np.zeros(9, np.int64)}, SETTINGS, "no such tensor of floats"),
        ({"action_net__bias": np.full(9, 1e300)}, SETTINGS, "not finite"),
        ({"action_net__bias": np.zeros(8)}, SETTINGS, "must be"),
        ({"action_net__weight": np.zeros((9, 7))}, SETTINGS, "takes 7 numbers"),
        ({"mlp_extractor.policy_net.1.weight": np.zeros(8)}, SETTINGS, "another module"),
        ({"mlp_extractor.policy_net.0.weight": np.zeros((8, 41), np.float32)}, SETTINGS, "nearest ready-made layout is pose"),
        ({"lstm_actor.weight_ih_l0": np.zeros((8, 8))}, SETTINGS, "its memory"),
        (
            {"action_net__weight": np.zeros((9, 8), np.float32), "lstm_actor.weight_hr_l0": np.zeros((8, 8))},
            SETTINGS,
            "its memory",
        ),
        ({"features_extractor.cnn.0.weight": np.zeros((8, 8))}, SETTINGS, "images"),
        ({}, Settings(None, squashed=False, low=None, high=None, mean_clip=2.0), "action space"),
        ({}, Settings(None, squashed=False, low=(1.0,) * 9, high=(-1.0,) * 9, mean_clip=2.0), "action space"),
    ],
)
def test_what_cannot_be_rebuilt_is_refused_with_its_part(changes, settings, says):
    with pytest.raises(UnfitError, match=says) as error:
        sb3_network.rebuilt(named(**changes), settings, LAYOUT)
    assert error.value.part
