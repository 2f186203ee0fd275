"""The native engine: hands MuJoCo's functions and the simulations' addresses to C++."""

import ctypes
import platform
from collections.abc import Callable, Sequence

import mujoco
import numpy as np

from sumo_dist.errors import SumoError, UsageError, unknown
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.variation import Variation
from sumo_dist.policies import g1_layout, hold, spot_layout
from sumo_dist.policies.policy import Policy
from sumo_dist.rollout import _native
from sumo_dist.rollout.base import DIVERGED, RESET_STATE, Request, RolloutEngine, frame_arrays
from sumo_dist.rollout.interface import Rollouts

GROUP = 8  # rows that a thread advances together: they share a network evaluation


def identity(portable: bool) -> tuple[str, str]:
    """Return the engine's name and build."""
    _, bits = _native.kernels()[0 if portable else -1]
    versions = (_native.SOURCE_HASH, bits, f"mujoco{mujoco.__version__}", platform.machine())
    return f"native-{bits}", "-".join(versions)


class NativeEngine(RolloutEngine):
    """Rollouts on native threads; the GIL is released for the whole call."""

    def __init__(
        self,
        model: mujoco.MjModel,
        policy: Policy,
        frames: tuple[FrameRef, ...],
        threads: int,
        variations: Sequence[Variation] = (),
        portable: bool = False,
    ) -> None:
        super().__init__(model, policy, frames, threads, variations)
        self.name, self.build = identity(portable)
        self._pool = [mujoco.MjData(self._model) for _ in range(threads)]
        simulations = [self._simulation(data) for data in self._pool]
        self._engine: _native.Engine | None = _native.Engine(
            self._physics(), native_policy(policy, portable), simulations, GROUP
        )

    def close(self) -> None:
        """Stop the engine's threads and free its simulations; harmless when repeated."""
        self._engine = None
        self._pool = []

    def _roll_out(self, request: Request, out: Rollouts) -> None:
        if self._engine is None:
            raise UsageError("this rollout engine is closed")
        self._engine.rollout(
            request.starts,
            request.memories,
            request.commands,
            request.models,
            out.states,
            out.targets,
            out.positions,
            out.rotations,
            out.memory,
            out.valid,
        )

    def _physics(self) -> _native.Physics:
        # The bindings' own module resolves to the one libmujoco that is loaded.
        library = ctypes.CDLL(mujoco._functions.__file__)
        return _native.Physics(
            models=[model._address for model in self._models],
            step=_function(library, "mj_step"),
            set_state=_function(library, "mj_setState"),
            get_state=_function(library, "mj_getState"),
            kinematics=_function(library, "mj_kinematics"),
            signature=RESET_STATE,
            state_size=len(self._rest),
            nq=self._model.nq,
            nv=self._model.nv,
            nu=self._model.nu,
            qpos=self._before,
            substeps=self._substeps,
        )

    def _simulation(self, data: mujoco.MjData) -> _native.Simulation:
        frames = (frame_arrays(data, kind, index) for kind, index in self._frame_ids)
        counters = data.warning.number
        return _native.Simulation(
            data=data._address,
            qpos=data.qpos.ctypes.data,
            qvel=data.qvel.ctypes.data,
            ctrl=data.ctrl.ctypes.data,
            frames=[(position.ctypes.data, rotation.ctypes.data) for position, rotation in frames],
            warnings=[counters[warning:].ctypes.data for warning in DIVERGED],
        )


class NativeController:
    """The policy by the engine's own code, one robot at a time; see `interface.Controller`."""

    def __init__(self, policy: Policy, portable: bool = False) -> None:
        self._initial_memory = policy.initial_memory()
        self._targets = len(policy.contract.joints)
        self._policy = native_policy(policy, portable)

    def initial_memory(self) -> np.ndarray:
        """Return the memory of a policy that was just started, (nm,) float32."""
        return self._initial_memory.copy()

    def step(
        self, qpos: np.ndarray, qvel: np.ndarray, command: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """(nq,), (nv,), (nc,), (nm,) -> joint targets (nu,) [rad] and the next memory (nm,)."""
        targets = np.empty(self._targets)
        following = np.array(memory, np.float32)
        try:
            self._policy.step(
                np.ascontiguousarray(qpos, np.float64),
                np.ascontiguousarray(qvel, np.float64),
                np.ascontiguousarray(command, np.float64),
                following,
                targets,
            )
        except (TypeError, ValueError):
            shapes = ", ".join(str(np.shape(a)) for a in (qpos, qvel, command, memory))
            raise SumoError(f"policy step: shapes {shapes} do not fit the policy") from None
        return targets, following


def _spot_relic(policy: Policy, portable: bool) -> _native.Policy:
    layout = _native.SpotLayout()
    layout.joints_to_network = spot_layout.JOINTS_TO_NETWORK
    layout.action_to_legs = spot_layout.ACTION_TO_LEGS
    layout.joint_offsets = spot_layout.JOINT_OFFSETS
    layout.action_scale = spot_layout.ACTION_SCALE
    layout.leg_size = spot_layout.LEG_SIZE
    layout.command_size = spot_layout.COMMAND_SIZE
    layout.command_arm = spot_layout.COMMAND_ARM_JOINTS.start
    layout.command_legs = spot_layout.COMMAND_LEGS.start
    return _native.spot_relic(policy.layers, layout, portable)


def _g1_gait(policy: Policy, portable: bool) -> _native.Policy:
    layout = _native.G1Layout()
    layout.joint_offsets = g1_layout.JOINT_OFFSETS
    layout.action_scale = g1_layout.ACTION_SCALE
    layout.spin_scale = g1_layout.SPIN_SCALE
    layout.joint_speed_scale = g1_layout.JOINT_SPEED_SCALE
    layout.phases = g1_layout.PHASES.tolist()
    layout.standing = g1_layout.STANDING
    layout.stand_below = g1_layout.STAND_BELOW
    layout.feedback_gain = g1_layout.FEEDBACK_GAIN
    layout.feedback_limit = g1_layout.FEEDBACK_LIMIT
    layout.feedback_share = g1_layout.FEEDBACK_SHARE
    layout.first_arm = g1_layout.ARMS.start
    layout.arm_size = g1_layout.ARM_SIZE
    layout.command_size = g1_layout.COMMAND_SIZE
    layout.command_arms = g1_layout.COMMAND_ARMS.start
    layout.command_follows = g1_layout.COMMAND_FOLLOWS.start
    layout.memory_size = g1_layout.MEMORY_SIZE
    layout.memory_gait = g1_layout.MEMORY_GAIT
    layout.memory_velocity = g1_layout.MEMORY_VELOCITY.start
    return _native.g1_gait(policy.layers, layout, portable)


def _hold_targets(policy: Policy, portable: bool) -> _native.Policy:
    del portable  # there is no network
    return _native.hold_targets(len(policy.contract.joints))


NATIVE_POLICIES: dict[str, Callable[[Policy, bool], _native.Policy]] = {
    spot_layout.KIND: _spot_relic,
    g1_layout.KIND: _g1_gait,
    hold.KIND: _hold_targets,
}


def native_policy(policy: Policy, portable: bool) -> _native.Policy:
    """Build the native twin of a policy.

    Raises:
        UsageError: policies of this kind have none.
    """
    if policy.kind not in NATIVE_POLICIES:
        raise unknown("native policy", policy.kind, NATIVE_POLICIES)
    return NATIVE_POLICIES[policy.kind](policy, portable)


def _function(library: ctypes.CDLL, name: str) -> int:
    address = ctypes.cast(getattr(library, name), ctypes.c_void_p).value
    assert address is not None
    return address
