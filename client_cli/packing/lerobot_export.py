"""Exports an ACT policy of LeRobot to TorchScript, with its normalisers and its queue of actions inside:

    python lerobot_export.py FOLDER OUT.pt

A program of its own for an environment that has LeRobot; it needs nothing of trifarm. The program takes an observation (1, n),
which is ``observation.state`` and then ``observation.environment_state``, the queue and its place, and gives an action, the queue
and its place. Before it ends it holds the program against LeRobot's own ``select_action`` between LeRobot's own processors.
"""

import json
import sys
from pathlib import Path

import torch

STATE, ENVIRONMENT, ACTION = "observation.state", "observation.environment_state", "action"
GROUPS = {STATE: "STATE", ENVIRONMENT: "ENV", ACTION: "ACTION"}
STEPS, SEED, LIMIT, REFUSED = 230, 7, 1e-4, 3


class Act(torch.nn.Module):
    """The policy as a function of what is seen and of what was planned."""

    def __init__(self, policy, statistics):
        super().__init__()
        self.model, self.config = policy.model, policy.config
        self.parts = parts_of(policy)
        self.modes = {key: str(policy.config.normalization_mapping.get(group, "IDENTITY")) for key, group in GROUPS.items()}
        self.statistics = statistics

    def scaled(self, key, x, back=False):
        """Normalised as LeRobot does, or back."""
        mode = self.modes[key].rpartition(".")[2]
        if mode == "MEAN_STD":
            mean, std = self.statistics[key]["mean"], self.statistics[key]["std"]
            return x * std + mean if back else (x - mean) / (std + 1e-8)
        if mode == "MIN_MAX":
            low, high = self.statistics[key]["min"], self.statistics[key]["max"]
            return (x + 1) / 2 * (high - low) + low if back else 2 * (x - low) / (high - low) - 1
        if mode == "IDENTITY":
            return x
        return refuse(f"the normalisation {mode} of {key} is not known here")

    def forward(self, observation, queue, place):
        """The action (1, 9), the queue (1, k, 9) and the place in it (1, 1)."""
        widths = [width for _, width in self.parts]
        seen = {key: self.scaled(key, x) for (key, _), x in zip(self.parts, observation.split(widths, dim=1), strict=True)}
        planned = self.model(seen)[0][:, : self.config.n_action_steps]
        fresh = (place < 0.5).float()[:, :, None]
        queue = planned * fresh + queue * (1 - fresh)
        action = self.scaled(ACTION, queue[:, 0], back=True)
        place = place + 1
        place = place * (place < self.config.n_action_steps - 0.5).float()
        return action, torch.cat([queue[:, 1:], queue[:, :1]], dim=1), place


def parts_of(policy):
    """What the observation is made of, in order: names and widths."""
    features = policy.config.input_features
    return [(key, features[key].shape[0]) for key in (STATE, ENVIRONMENT) if key in features]


def refuse(why):
    """Says why and ends."""
    print(why)
    sys.exit(REFUSED)


def statistics_of(folder, tensors):
    """Numbers of the normalisers, from the processors' files or, of older policies, from the weights themselves."""
    found = {}
    for file in sorted(folder.glob("policy_*normalizer_processor.safetensors")):
        for name, values in load(file).items():
            key, _, which = name.rpartition(".")
            found.setdefault(key, {})[which] = values.float()
    for name, values in tensors.items():
        if name.startswith(("normalize_inputs.", "unnormalize_outputs.")):
            _, buffer, which = name.split(".")
            key = buffer.removeprefix("buffer_").replace("_", ".", 1)
            found.setdefault(key, {})[which] = values.float()
    return found


def load(file):
    """The tensors of a file."""
    from safetensors.torch import load_file

    return load_file(file)


def difference(policy, program, folder, size):
    """The largest difference of an action from LeRobot's own, over more than one queue; the largest action."""
    from lerobot.policies.factory import make_pre_post_processors

    before, after = make_pre_post_processors(policy.config, pretrained_path=str(folder))
    torch.manual_seed(SEED)
    policy.reset()
    queue, place = blank(policy)
    worst = largest = 0.0
    for _ in range(STEPS):
        observation = torch.randn(1, size)
        keys, widths = zip(*parts_of(policy), strict=True)
        batch = dict(zip(keys, observation.split(list(widths), dim=1), strict=True))
        with torch.no_grad():
            wanted = after(policy.select_action(before(batch)))
            got, queue, place = program(observation, queue, place)
        worst, largest = max(worst, float((wanted - got).abs().max())), max(largest, float(wanted.abs().max()))
    return worst, largest


def blank(policy):
    """The states of a trial that begins."""
    return torch.zeros(1, policy.config.n_action_steps, policy.config.output_features[ACTION].shape[0]), torch.zeros(1, 1)


def main():
    """Export, compare, write."""
    folder, out = Path(sys.argv[1]), Path(sys.argv[2])
    from lerobot.policies.act.modeling_act import ACTPolicy

    torch.set_num_threads(1)
    policy = ACTPolicy.from_pretrained(folder).to("cpu").eval()
    policy.config.device = "cpu"
    if policy.config.image_features:
        refuse(f"it sees images ({', '.join(policy.config.image_features)}), which a robot of the farm does not show to a policy")
    if policy.config.temporal_ensemble_coeff is not None:
        refuse("it averages overlapping chunks (temporal_ensemble_coeff); save it with n_action_steps instead")
    torch.backends.mha.set_fastpath_enabled(False)
    tensors = load(folder / "model.safetensors")
    program = Act(policy, statistics_of(folder, tensors)).eval()
    size = sum(width for _, width in program.parts)
    with torch.no_grad():
        traced = torch.jit.trace(program, (torch.zeros(1, size), *blank(policy)), check_trace=False)
    has_processors = (folder / "policy_preprocessor.json").is_file()
    if has_processors:
        worst, largest = difference(policy, traced, folder, size)
        if not worst <= LIMIT * max(1.0, largest):
            refuse(f"the exported program differs from LeRobot's own by {worst:.3g} (largest action {largest:.3g})")
        print(f"differs from LeRobot's own by at most {worst:.2g} in {STEPS} steps (largest action {largest:.3g})")
    states = [list(each.shape) for each in blank(policy)]
    torch.jit.save(traced, str(out), _extra_files={"trifarm.json": json.dumps({"states": states})})


if __name__ == "__main__":
    main()
