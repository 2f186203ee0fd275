"""Completes an image: fetches all policies' weights, and fails if there is no native engine.

An installation without a compiler has another engine, without a word, whose workers nobody asks.
"""

from sumo_dist.policies.fetch import policy_file
from sumo_dist.policies.manifest import read_manifest
from sumo_dist.rollout import engine_identity

engine_identity("native")
for name in read_manifest():
    policy_file(name)
