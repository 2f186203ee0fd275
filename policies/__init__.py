"""Low-level policies: pretrained networks that turn a command into joint targets."""

from sumo_dist.policies import g1, spot
from sumo_dist.policies.contract import PolicyContract
from sumo_dist.policies.fetch import policy_file
from sumo_dist.policies.manifest import pinned_policy
from sumo_dist.policies.policy import Policy

__all__ = ["Policy", "PolicyContract", "load_policy", "policy_file"]

_LOADERS = {spot.KIND: spot.load, g1.KIND: g1.load}  # by kind in manifest.toml


def load_policy(name: str) -> Policy:
    """Load a pretrained policy, fetching its weights on first need.

    Args:
        name: a policy of manifest.toml.

    Raises:
        UsageError: there is no policy of that name.
        SumoError: its weights are damaged or out of reach.
    """
    pinned = pinned_policy(name)
    return _LOADERS[pinned.kind](pinned, policy_file(name))
