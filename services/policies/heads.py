"""From a network's outputs to nine numbers: as they are, the means of Gaussians, or the centres of the preferred bins."""

import numpy as np

from api_schemas.policy import ACTION_SIZE, PolicyManifest
from api_schemas.policy_network import ActionHead
from services.policies.scaling import Chain


def take_action(chain: Chain, manifest: PolicyManifest) -> None:
    """Goes on from the network's outputs, shape (1, outputs), to shape (1, 9).

    The bins of a joint lie evenly in [-1, 1], the first at -1 and the last at 1; of equal preferences the first is taken.
    """
    if manifest.head is ActionHead.GAUSSIAN:
        chain.constant("means", np.arange(ACTION_SIZE))
        chain.at = chain.node("Gather", [chain.at, "means"], "mean_action", axis=1)
    if manifest.head is ActionHead.BINS:
        assert manifest.bins is not None, "the manifest's validator asks for them"
        chain.constant("bins_shape", np.array([1, ACTION_SIZE, manifest.bins]))
        chain.constant("bin_centres", np.linspace(-1, 1, manifest.bins).astype(np.float32))
        chain.node("Reshape", [chain.at, "bins_shape"], "preferences")
        chain.node("ArgMax", ["preferences"], "preferred", axis=2, keepdims=0)
        chain.at = chain.node("Gather", ["bin_centres", "preferred"], "bin_action")
