"""The one error of conversion, and the sentence for shapes that do not fit."""

from api_schemas.policy import ACTION_SIZE, LAYOUTS, OBSERVATION_SIZES, PolicyManifest


class UnfitError(Exception):
    """The weights and the manifest do not make a policy; the message says why and what to do."""


def wrong_input(manifest: PolicyManifest, network_inputs: int) -> UnfitError:
    """The error for a network whose input does not have the manifest's size."""
    fields = ", ".join(f"{name} {OBSERVATION_SIZES[name]}" for name in manifest.observation)
    nearest = min(LAYOUTS, key=lambda name: abs(LAYOUTS[name].observation_size - network_inputs))
    return UnfitError(
        f"the manifest's observation has {manifest.observation_size} numbers ({fields}), but the network takes "
        f"{network_inputs}; the nearest ready-made layout is {nearest} with {LAYOUTS[nearest].observation_size}"
    )


def wrong_output(network_outputs: object) -> UnfitError:
    """The error for a network that does not give nine numbers."""
    return UnfitError(f"the network gives {network_outputs} numbers, but an action has {ACTION_SIZE}: one for each joint")
