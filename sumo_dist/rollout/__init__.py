"""Policy-in-the-loop rollouts: a native engine, and a fallback where it was not compiled."""

from collections.abc import Sequence
from importlib.util import find_spec

import mujoco

from sumo_dist.errors import UsageError, unknown
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.variation import Variation
from sumo_dist.policies.policy import Policy
from sumo_dist.rollout.interface import Controller, Engine, Rollouts

__all__ = [
    "ENGINES",
    "Controller",
    "Engine",
    "Rollouts",
    "engine_identity",
    "make_controller",
    "make_engine",
]

ENGINES = ("auto", "native", "native-portable", "fallback")

# An engine is imported where it is made: the native one may not be there.


def make_engine(
    model: mujoco.MjModel,
    policy: Policy,
    frames: tuple[FrameRef, ...],
    threads: int,
    kind: str = "auto",
    variations: Sequence[Variation] = (),
) -> Engine:
    """Start a rollout engine.

    Args:
        model: planning model with autoreset disabled; the engine keeps a copy. Its time step
            divides a tick, and the robot's joints and actuators come first.
        policy: the low-level policy inside the rollouts.
        frames: sites and bodies whose poses are recorded.
        threads: that share the rows, including the caller's.
        kind: one of ENGINES. "auto" is "native" where that was compiled, else "fallback";
            the network of "native-portable" gives the same bits on every CPU.
        variations: of the model, on which rows may run in its place; see `Engine.rollout`.

    Raises:
        UsageError: an unknown kind or frame, a model or variation that does not fit, or an engine
            that this installation does not have.
    """
    if _is_native(kind):
        from sumo_dist.rollout.native import NativeEngine

        portable = kind == "native-portable"
        return NativeEngine(model, policy, frames, threads, variations, portable)
    from sumo_dist.rollout.fallback import FallbackEngine

    return FallbackEngine(model, policy, frames, threads, variations)


def make_controller(policy: Policy, model: mujoco.MjModel, kind: str = "auto") -> Controller:
    """Return the policy as a function of one robot, by the same code as the engine of this kind.

    Raises:
        UsageError: as for `make_engine`.
    """
    if _is_native(kind):
        from sumo_dist.rollout.native import NativeController

        return NativeController(policy, portable=kind == "native-portable")
    return policy


def engine_identity(kind: str = "auto") -> tuple[str, str]:
    """Return name and build of the engine that a kind stands for, without starting it.

    Equal builds give equal bits; see `interface.Engine`.

    Raises:
        UsageError: as for `make_engine`.
    """
    if _is_native(kind):
        from sumo_dist.rollout.native import identity

        return identity(kind == "native-portable")
    from sumo_dist.rollout.fallback import identity as fallback_identity

    return fallback_identity()


def _is_native(kind: str) -> bool:
    if kind not in ENGINES:
        raise unknown("engine", kind, ENGINES)
    compiled = find_spec("sumo_dist.rollout._native") is not None
    if kind.startswith("native") and not compiled:
        raise UsageError(
            f"engine {kind!r} is not in this installation: it was built without a C++ compiler; "
            "valid: auto, fallback"
        )
    return compiled and kind != "fallback"
