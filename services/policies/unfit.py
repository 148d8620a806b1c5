"""The one error of conversion, and the sentence for shapes that do not fit."""

from api_schemas.policy import ACTION_SIZE, LAYOUTS, OBSERVATION_SIZES, PolicyManifest
from api_schemas.policy_network import ActionHead


class UnfitError(Exception):
    """The weights and the manifest do not make a policy; the message says why and what to do."""


def wrong_input(manifest: PolicyManifest, network_inputs: int) -> UnfitError:
    """The error for a network whose input does not have the manifest's size."""
    fields = ", ".join(f"{name} {OBSERVATION_SIZES[name]}" for name in manifest.observation)
    nearest = min(LAYOUTS, key=lambda name: abs(LAYOUTS[name].observation_size - network_inputs))
    return UnfitError(
        f"the manifest's observation has {manifest.observation_size} numbers ({fields}){_stacked(manifest)}, "
        f"but the network takes {network_inputs}; "
        f"the nearest ready-made layout is {nearest} with {LAYOUTS[nearest].observation_size}"
    )


def _stacked(manifest: PolicyManifest) -> str:
    stack = manifest.frame_stack
    return "" if stack is None else f", stacked {stack.count} times {manifest.network_inputs}"


def wrong_output(network_outputs: object, manifest: PolicyManifest) -> UnfitError:
    """The error for a network that does not give the numbers that an action is made of."""
    if manifest.head is ActionHead.DIRECT:
        return UnfitError(f"the network gives {network_outputs} numbers, but an action has {ACTION_SIZE}: one for each joint")
    return UnfitError(
        f"the network gives {network_outputs} numbers, but the head {manifest.head.value!r} needs {manifest.network_outputs}"
    )
