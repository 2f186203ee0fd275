"""Fetches the weights of all policies into the cache, where workers find them."""

from sumo_dist.policies.fetch import policy_file
from sumo_dist.policies.manifest import read_manifest

for name in read_manifest():
    policy_file(name)
