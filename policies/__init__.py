"""Low-level policies: pretrained networks that turn a command into joint targets."""

from sumo_dist.policies.contract import PolicyContract
from sumo_dist.policies.fetch import policy_file
from sumo_dist.policies.manifest import pinned_policy
from sumo_dist.policies.policy import Policy

__all__ = ["Policy", "PolicyContract", "load_policy", "policy_file"]


def load_policy(name: str) -> Policy:
    """Load a pretrained policy, fetching its weights on first need.

    Args:
        name: a policy of manifest.toml.

    Raises:
        UsageError: there is no policy of that name.
        SumoError: its weights are damaged or out of reach.
    """
    # Here, as they read weights with onnx: whoever asks for a layout alone does not wait for it.
    from sumo_dist.policies import g1, spot

    loaders = {spot.KIND: spot.load, g1.KIND: g1.load}  # by kind in manifest.toml
    pinned = pinned_policy(name)
    return loaders[pinned.kind](pinned, policy_file(name))
