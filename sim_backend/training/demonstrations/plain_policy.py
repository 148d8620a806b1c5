"""A policy of plain layers that training builds on: its weights in the units of what is practised."""

from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from api_schemas.policy import OutputScaling
from api_schemas.policy_network import ActionHead
from sim_backend.environments.action_space import ActionMode
from sim_backend.environments.practice import Practice
from sim_backend.training.actor_critic import CLIP, EPSILON, Inputs
from sim_backend.training.demonstrations.teacher import check_same_actions, find_policy
from sim_backend.training.export import ExportedPolicy, input_scaling_of


class PlainPolicy:
    """Layers with ELU between them that see what is practised, an output of 1 being the largest action.

    ``tensors`` are its weights, ``mean`` and ``variance`` of shape (seen,) scale its inputs, ``outputs`` makes actions (n, 9) of
    observations (n, seen).

    Args:
        policy: a shipped reference policy by its name, or a safetensors file.
        layout: what it expects, if no manifest lies beside it.
        practice: what is practised.
        purpose: what is wanted of it, for the message.

    Raises:
        ValueError: there is no such policy, or it is not of this kind; the message says why.
    """

    def __init__(self, policy: str, layout: str | None, practice: Practice, purpose: str) -> None:
        found = find_policy(policy, layout)
        manifest, after = found.manifest, found.manifest.output_scaling
        check_same_actions(manifest, practice.manifest)
        wrong = [
            reason
            for reason, holds in (
                (f"sees {', '.join(manifest.observation)}", manifest.observation != practice.manifest.observation),
                ("has cells", manifest.recurrent is not None),
                ("has bins", manifest.head is not ActionHead.DIRECT or practice.action_space.mode is ActionMode.BINS),
                (f"has {manifest.activation} layers", manifest.activation != "elu"),
                ("is not clipped at 5 and 1", (manifest.input_scaling.clip, after.clip) != (CLIP, 1.0)),
                ("has an offset of its own", bool(np.any(np.asarray(after.offset or 0.0) != practice.action_space.middle))),
            )
            if holds
        ]
        if wrong:
            raise ValueError(f"{policy} cannot {purpose} by this recipe: it {', '.join(wrong)}")
        self.name = policy
        centre, spread = input_scaling_of(found.tensors, manifest)
        self.mean, self.variance = centre, np.maximum(spread**2 - EPSILON, 0.0).astype(np.float32)
        scale = found.tensors["torque_limit_nm"] if after.scale is None else np.asarray(after.scale)
        self.tensors = dict(found.tensors)
        ratio, last = (scale / practice.action_space.largest).astype(np.float32), f"layer{len(found.layers) - 1}"
        self.tensors[f"{last}.weight"] = found.tensors[f"{last}.weight"] * ratio[:, None]
        self.tensors[f"{last}.bias"] = found.tensors[f"{last}.bias"] * ratio
        plain = manifest.model_copy(update={"output_scaling": OutputScaling(scale=1.0)})
        self.outputs = ExportedPolicy(self.tensors, plain)

    def fix_inputs(self, inputs: Inputs) -> None:
        """Let a policy that is trained scale what it sees as this one does."""
        inputs.fix(torch.from_numpy(self.mean), torch.from_numpy(self.variance))

    @torch.no_grad()
    def begin(self, inputs: Inputs, layers: Sequence[nn.Linear]) -> None:
        """Give these weights to linear layers, the first of which sees differences of places besides and does not use them yet.

        Raises:
            ValueError: its layers are of other sizes.
        """
        self.fix_inputs(inputs)
        sizes, wanted = ([len(layer.bias) for layer in layers[:-1]], [len(bias) for _, bias in self.outputs.layers[:-1]])
        if sizes != wanted:
            raise ValueError(f"{self.name} has hidden layers of {wanted} and the recipe of {sizes}; give it as many")
        for layer, (weight, bias) in zip(layers, self.outputs.layers, strict=True):
            layer.weight.zero_()
            layer.weight[:, : weight.shape[0]] = torch.from_numpy(np.ascontiguousarray(weight.T))
            layer.bias.copy_(torch.from_numpy(bias))


def begin_with(policy: str, layout: str | None, practice: Practice, inputs: Inputs, layers: Sequence[nn.Linear]) -> None:
    """Let what is to be trained begin as a policy; arguments and ValueError as of :class:`PlainPolicy`."""
    PlainPolicy(policy, layout, practice, "be begun with").begin(inputs, layers)
