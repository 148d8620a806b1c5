"""A few steps of training with rsl_rl, skrl and rl_games themselves: the checkpoint that each saves, and its own policy.

Each function writes a checkpoint and gives a function from the observations of a trial (steps, n) to its actions (steps, 9), in
units of the training and from no memory.
"""

import gymnasium
import numpy as np
import torch

from tests.unit.client_cli.packing.toy_env import ToyEnv

ENVS = 2


class RslRlEnv:
    """``rsl_rl.env.VecEnv``: random observations, a reward for small actions."""

    num_envs, num_actions, max_episode_length, device, cfg = ENVS, 9, 10, "cpu", {}

    def __init__(self, size):
        self.size, self.episode_length_buf = size, torch.zeros(ENVS, dtype=torch.long)

    def get_observations(self):
        from tensordict import TensorDict

        return TensorDict({"policy": torch.randn(ENVS, self.size) * 3 + 1}, batch_size=[ENVS])

    def step(self, actions):
        self.episode_length_buf += 1
        dones = self.episode_length_buf >= self.max_episode_length
        self.episode_length_buf[dones] = 0
        return self.get_observations(), -(actions**2).sum(1), dones.long(), {"time_outs": dones}


def rsl_rl(path, size, memory):
    """Trains with rsl_rl's runner; ``memory`` is lstm, gru or None."""
    from rsl_rl.runners import OnPolicyRunner
    from tensordict import TensorDict

    recurrent = {"rnn_type": memory, "rnn_hidden_dim": 16, "rnn_num_layers": 1} if memory else {}
    model = {
        "class_name": "RNNModel" if memory else "MLPModel",
        "hidden_dims": [24],
        "activation": "elu",
        "obs_normalization": True,
        **recurrent,
    }
    gaussian = {"class_name": "GaussianDistribution", "init_std": 1.0}
    settings = {
        "seed": 1,
        "num_steps_per_env": 8,
        "save_interval": 100,
        "obs_groups": {"actor": ["policy"], "critic": ["policy"]},
        "actor": model | {"distribution_cfg": gaussian},
        "critic": dict(model),
        "algorithm": {"class_name": "PPO", "num_learning_epochs": 2, "num_mini_batches": 1, "learning_rate": 1e-2},
    }
    runner = OnPolicyRunner(RslRlEnv(size), settings, log_dir=None, device="cpu")
    runner.learn(2)
    torch.save(runner.alg.save() | {"iter": 2, "infos": None}, path)
    policy = runner.get_inference_policy()

    def actions(trial):
        policy.reset()
        rows = [policy(TensorDict({"policy": row[None]}, batch_size=[1])) for row in trial]
        return torch.cat(rows)

    return actions


def skrl(path, size):
    """Trains with skrl's PPO and a Gaussian model of its instantiator."""
    from skrl.agents.torch.ppo import PPO, PPO_CFG
    from skrl.envs.wrappers.torch import wrap_env
    from skrl.memories.torch import RandomMemory
    from skrl.resources.preprocessors.torch import RunningStandardScaler
    from skrl.trainers.torch import SequentialTrainer
    from skrl.utils.model_instantiators.torch import deterministic_model, gaussian_model

    env = wrap_env(ToyEnv(size), wrapper="gymnasium", verbose=False)
    spaces = {"observation_space": env.observation_space, "action_space": env.action_space, "device": env.device}
    network = [{"name": "net", "input": "OBSERVATIONS", "layers": [24, 16], "activations": "elu"}]
    models = {
        "policy": gaussian_model(**spaces, network=network, output="ACTIONS"),
        "value": deterministic_model(**spaces, network=network, output="ONE"),
    }
    settings = PPO_CFG(
        rollouts=16,
        learning_epochs=2,
        mini_batches=1,
        observation_preprocessor=RunningStandardScaler,
        observation_preprocessor_kwargs={"size": env.observation_space, "device": env.device},
    )
    settings.experiment.write_interval = settings.experiment.checkpoint_interval = 0
    agent = PPO(models=models, memory=RandomMemory(memory_size=16, num_envs=1, device=env.device), cfg=settings, **spaces)
    quiet = {"timesteps": 32, "headless": True, "disable_progressbar": True, "close_environment_at_exit": False}
    SequentialTrainer(env=env, agents=agent, cfg=quiet).train()
    agent.save(str(path))

    def actions(trial):
        seen = agent._observation_preprocessor(trial)
        return models["policy"].act({"observations": seen}, role="policy")[1]["mean_actions"]

    return actions


class RlGamesEnv:
    """``rl_games.common.ivecenv.IVecEnv``: the same for an agent of rl_games."""

    def __init__(self, size):
        self.size, self.steps = size, 0

    def get_env_info(self):
        box = gymnasium.spaces.Box(-np.inf, np.inf, (self.size,), np.float32)
        return {"observation_space": box, "action_space": gymnasium.spaces.Box(-1.0, 1.0, (9,), np.float32), "agents": 1}

    def reset(self):
        return torch.randn(ENVS, self.size) * 3 + 1

    def step(self, actions):
        self.steps += 1
        dones = torch.full((ENVS,), self.steps % 10 == 0)
        return self.reset(), -(actions**2).sum(1), dones.to(torch.uint8), {}

    def get_number_of_agents(self):
        return 1

    def get_env_state(self):
        return None

    def set_train_info(self, *_):
        pass


def rl_games(path, size, memory):
    """Trains with the continuous agent of rl_games; ``memory`` is lstm, gru or None."""
    from rl_games.algos_torch.a2c_continuous import A2CAgent
    from rl_games.algos_torch.model_builder import ModelBuilder
    from rl_games.common.algo_observer import DefaultAlgoObserver
    from rl_games.common.tr_helpers import DefaultRewardsShaper

    initial = {"name": "default"}
    network = {
        "name": "actor_critic",
        "separate": False,
        "space": {
            "continuous": {
                "mu_activation": "None",
                "sigma_activation": "None",
                "mu_init": initial,
                "sigma_init": {"name": "const_initializer", "val": 0},
                "fixed_sigma": True,
            }
        },
        "mlp": {"units": [24, 16], "activation": "elu", "d2rl": False, "initializer": initial, "regularizer": {"name": "None"}},
    }
    if memory:
        network["rnn"] = {"name": memory, "units": 20, "layers": 1, "before_mlp": False, "layer_norm": True}
    params = {"algo": {"name": "a2c_continuous"}, "model": {"name": "continuous_a2c_logstd"}, "network": network}
    env = RlGamesEnv(size)
    config = {
        "name": "cube",
        "full_experiment_name": "cube",
        "train_dir": str(path.parent / "runs"),
        "env_name": "none",
        "vec_env": env,
        "env_info": env.get_env_info(),
        "device": "cpu",
        "device_name": "cpu",
        "ppo": True,
        "num_actors": ENVS,
        "horizon_length": 8,
        "minibatch_size": 16,
        "mini_epochs": 2,
        "seq_length": 4,
        "normalize_input": True,
        "normalize_value": True,
        "normalize_advantage": True,
        "gamma": 0.99,
        "tau": 0.95,
        "learning_rate": 1e-2,
        "lr_schedule": None,
        "grad_norm": 1.0,
        "truncate_grads": True,
        "entropy_coef": 0.0,
        "critic_coef": 2,
        "clip_value": True,
        "e_clip": 0.2,
        "bounds_loss_coef": 0.0,
        "score_to_win": 1e9,
        "max_epochs": 2,
        "print_stats": False,
        "save_best_after": 1000,
        "reward_shaper": DefaultRewardsShaper(),
        "features": {"observer": DefaultAlgoObserver()},
    }
    config["network"] = ModelBuilder().load(params)
    agent = A2CAgent("run", params | {"config": config})
    agent.train()
    agent.save(str(path.with_suffix("")))
    model = agent.model.eval()

    def actions(trial):
        states = [torch.zeros_like(each[:, :1]) for each in model.get_default_rnn_state()] if memory else None
        rows = []
        for row in trial:
            said = model({"is_train": False, "prev_actions": None, "obs": row[None], "rnn_states": states})
            rows.append(said["mus"].clamp(-1, 1))
            states = said["rnn_states"]
        return torch.cat(rows)

    return actions
