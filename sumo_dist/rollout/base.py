"""What the engines share: checks of model and request, the recorded frames, their lifetime."""

import copy
from abc import ABC, abstractmethod
from typing import Self

import mujoco
import numpy as np

from sumo_dist.errors import UsageError, unknown
from sumo_dist.model.frames import FrameRef
from sumo_dist.policies.policy import Policy
from sumo_dist.rollout.interface import Rollouts
from sumo_dist.timing import TICK

RESET_STATE = int(mujoco.mjtState.mjSTATE_INTEGRATION)  # everything a step starts from
HUGE = 1e10  # magnitude at which MuJoCo calls a value bad

# Warnings after which MuJoCo, its autoreset disabled, carries on with meaningless numbers.
DIVERGED = tuple(
    int(warning)
    for warning in (
        mujoco.mjtWarning.mjWARN_BADQPOS,
        mujoco.mjtWarning.mjWARN_BADQVEL,
        mujoco.mjtWarning.mjWARN_BADQACC,
        mujoco.mjtWarning.mjWARN_BADCTRL,
    )
)


class RolloutEngine(ABC):
    """An engine on a copy of a model; a context manager. See `interface.Engine`."""

    name: str
    build: str

    def __init__(
        self, model: mujoco.MjModel, policy: Policy, frames: tuple[FrameRef, ...], threads: int
    ) -> None:
        if threads < 1:
            raise UsageError(f"threads: {threads}; at least 1 is needed")
        self.frames = tuple(frames)
        self._model = copy.copy(model)
        self._policy = policy
        self._substeps = _substeps(self._model)
        self._frame_ids = [_frame_id(self._model, frame) for frame in self.frames]
        self._data = mujoco.MjData(self._model)
        if self._model.nu != len(policy.contract.joints):
            raise UsageError(
                f"the model has {self._model.nu} actuators, "
                f"policy {policy.contract.name!r} drives {len(policy.contract.joints)}"
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def rollout(self, state: np.ndarray, memory: np.ndarray, commands: np.ndarray) -> Rollouts:
        """Roll out B command sequences from one state; see `interface.Engine.rollout`.

        Raises:
            UsageError: an array of the wrong shape or with a non-finite number, or the engine
                is closed.
        """
        size, contract = self._model.nq + self._model.nv, self._policy.contract
        state = _checked("state", state, (size,), np.float64)
        memory = _checked("memory", memory, (contract.memory_size,), np.float32)
        commands = _checked("commands", commands, (None, None, contract.command_size), np.float64)
        rows, ticks = commands.shape[:2]
        out = Rollouts(
            states=np.empty((rows, ticks, size)),
            positions=np.empty((rows, ticks, len(self.frames), 3)),
            rotations=np.empty((rows, ticks, len(self.frames), 3, 3)),
            memory=np.empty((rows, contract.memory_size), np.float32),
            valid=np.empty(rows, np.bool_),
        )
        self._roll_out(self._reset_state(state), memory, commands, out)
        return out

    @abstractmethod
    def close(self) -> None:
        """Stop the engine's threads and free its simulations; harmless when repeated."""

    @abstractmethod
    def _roll_out(
        self, start: np.ndarray, memory: np.ndarray, commands: np.ndarray, out: Rollouts
    ) -> None:
        """Fill `out`; every row starts from `start`, a state vector as of RESET_STATE."""

    def _reset_state(self, state: np.ndarray) -> np.ndarray:
        """Complete qpos and qvel to what resets a simulation; the solver's warm start is zero."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos[:] = state[: self._model.nq]
        self._data.qvel[:] = state[self._model.nq :]
        start = np.empty(mujoco.mj_stateSize(self._model, RESET_STATE))
        mujoco.mj_getState(self._model, self._data, start, RESET_STATE)
        return start


def frame_arrays(data: mujoco.MjData, kind: str, index: int) -> tuple[np.ndarray, np.ndarray]:
    """Return live views of a frame's position (3,) and rotation (9,) in `data`."""
    if kind == "site":
        return data.site_xpos[index], data.site_xmat[index]
    return data.xpos[index], data.xmat[index]


def _frame_id(model: mujoco.MjModel, frame: FrameRef) -> tuple[str, int]:
    objects = {
        "site": (mujoco.mjtObj.mjOBJ_SITE, model.nsite),
        "body": (mujoco.mjtObj.mjOBJ_BODY, model.nbody),
    }
    if frame.kind not in objects:
        raise unknown("kind of frame", frame.kind, objects)
    kind, count = objects[frame.kind]
    index = mujoco.mj_name2id(model, kind, frame.name)
    if index < 0:
        names = (mujoco.mj_id2name(model, kind, i) for i in range(count))
        raise unknown(frame.kind, frame.name, filter(None, names))
    return frame.kind, index


def _substeps(model: mujoco.MjModel) -> int:
    """Return the physics steps of a tick; refuse a model that cannot be planned on."""
    if not model.opt.disableflags & mujoco.mjtDisableBit.mjDSBL_AUTORESET:
        raise UsageError(
            "the model resets itself when it diverges, which hides the divergence: "
            'compile it with <option><flag autoreset="disable"/></option>'
        )
    substeps = round(TICK / model.opt.timestep)
    if substeps < 1 or abs(substeps * model.opt.timestep - TICK) > 1e-9:
        raise UsageError(f"time step {model.opt.timestep:g} s does not divide {TICK:g} s")
    return substeps


def _checked(
    name: str, array: np.ndarray, shape: tuple[int | None, ...], dtype: type
) -> np.ndarray:
    """Return a contiguous array of this type; None in `shape` is any size from 1 on."""
    array = np.ascontiguousarray(array, dtype)
    fits = len(array.shape) == len(shape) and all(
        found > 0 if wanted is None else found == wanted
        for found, wanted in zip(array.shape, shape, strict=True)
    )
    if not fits:
        wanted = ", ".join("n" if size is None else str(size) for size in shape)
        raise UsageError(f"{name} has shape {array.shape}, not ({wanted})")
    if not np.all(np.abs(array) <= HUGE):
        raise UsageError(f"{name} is not finite or beyond {HUGE:g}")
    return array
