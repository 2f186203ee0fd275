"""What the engines share: checks of model and request, the recorded frames, their lifetime."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import mujoco
import numpy as np

from sumo_dist.errors import UsageError, unknown
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.variation import Variation, varied
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


@dataclass(frozen=True)
class Request:
    """What to roll out, checked and complete.

    Attributes:
        starts: (B or 1, n) states as of RESET_STATE; a single one is shared by all rows.
        memories: (B or 1, nm) float32 policy memory before the first step, likewise.
        commands: (B, T, nc).
        models: (B,) int32, 0 for the model itself, i for its i-th variation.
    """

    starts: np.ndarray
    memories: np.ndarray
    commands: np.ndarray
    models: np.ndarray


class RolloutEngine(ABC):
    """An engine on a copy of a model; a context manager. See `interface.Engine`."""

    name: str
    build: str

    def __init__(
        self,
        model: mujoco.MjModel,
        policy: Policy,
        frames: tuple[FrameRef, ...],
        threads: int,
        variations: Sequence[Variation] = (),
    ) -> None:
        if threads < 1:
            raise UsageError(f"threads: {threads}; at least 1 is needed")
        self.frames = tuple(frames)
        self._model = copy.copy(model)
        self._policy = policy
        self._substeps = _substeps(self._model)
        self._frame_ids = [_frame_id(self._model, frame) for frame in self.frames]
        if self._model.nu != len(policy.contract.joints):
            raise UsageError(
                f"the model has {self._model.nu} actuators, "
                f"policy {policy.contract.name!r} drives {len(policy.contract.joints)}"
            )
        self._models = (self._model, *(varied(self._model, v) for v in variations))
        self._rest = _rest(self._model)
        self._before = mujoco.mj_stateSize(self._model, int(mujoco.mjtState.mjSTATE_TIME))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def rollout(
        self,
        state: np.ndarray,
        memory: np.ndarray,
        commands: np.ndarray,
        models: np.ndarray | None = None,
    ) -> Rollouts:
        """Roll out B command sequences; see `interface.Engine.rollout`.

        Raises:
            UsageError: an array of the wrong shape or with a non-finite number, a model that is
                not there, or the engine is closed.
        """
        size, contract = self._model.nq + self._model.nv, self._policy.contract
        sequences = (None, None, contract.command_size)
        commands = _checked("commands", commands, np.float64, sequences)
        rows, ticks = commands.shape[:2]
        state = _per_row("state", state, np.float64, rows, size)
        memory = _per_row("memory", memory, np.float32, rows, contract.memory_size)
        request = Request(self._starts(state), memory, commands, self._chosen(models, rows))
        out = Rollouts(
            states=np.empty((rows, ticks, size)),
            targets=np.empty((rows, ticks, self._model.nu)),
            positions=np.empty((rows, ticks, len(self.frames), 3)),
            rotations=np.empty((rows, ticks, len(self.frames), 3, 3)),
            memory=np.empty((rows, contract.memory_size), np.float32),
            valid=np.empty(rows, np.bool_),
        )
        self._roll_out(request, out)
        return out

    @abstractmethod
    def close(self) -> None:
        """Stop the engine's threads and free its simulations; harmless when repeated."""

    @abstractmethod
    def _roll_out(self, request: Request, out: Rollouts) -> None:
        """Fill `out` with what is asked for."""

    def _starts(self, states: np.ndarray) -> np.ndarray:
        """Complete qpos and qvel (n, nq + nv) to what resets a simulation."""
        starts = np.tile(self._rest, (len(states), 1))
        starts[:, self._before : self._before + states.shape[1]] = states
        return starts

    def _chosen(self, models: np.ndarray | None, rows: int) -> np.ndarray:
        if models is None:
            return np.zeros(rows, np.int32)
        chosen = np.asarray(models)
        if chosen.shape != (rows,) or chosen.dtype.kind not in "iu":
            raise UsageError(
                f"models has shape {chosen.shape} of {chosen.dtype}, not ({rows},) of integers"
            )
        last = len(self._models) - 1
        wrong = chosen[(chosen < 0) | (chosen > last)]
        if len(wrong):
            raise UsageError(
                f"there is no model {wrong[0]}; valid: 0, the model itself, to {last}, "
                "the number of its variations"
            )
        return chosen.astype(np.int32)


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


def _rest(model: mujoco.MjModel) -> np.ndarray:
    """State of a reset simulation as of RESET_STATE, (n,); the solver's warm start is zero."""
    rest = np.empty(mujoco.mj_stateSize(model, RESET_STATE))
    mujoco.mj_getState(model, mujoco.MjData(model), rest, RESET_STATE)
    return rest


def _per_row(name: str, array: np.ndarray, dtype: type, rows: int, size: int) -> np.ndarray:
    """Return (rows, size), or (1, size) of an array (size,) that all rows share."""
    return np.atleast_2d(_checked(name, array, dtype, (size,), (rows, size)))


def _checked(
    name: str, array: np.ndarray, dtype: type, *shapes: tuple[int | None, ...]
) -> np.ndarray:
    """Return a contiguous array of one of these shapes; None is any size from 1 on."""
    array = np.ascontiguousarray(array, dtype)
    if not any(_fits(array.shape, shape) for shape in shapes):
        wanted = (", ".join("n" if n is None else str(n) for n in shape) for shape in shapes)
        listed = " or ".join(f"({sizes})" for sizes in wanted)
        raise UsageError(f"{name} has shape {array.shape}, not {listed}")
    if not np.all(np.abs(array) <= HUGE):
        raise UsageError(f"{name} is not finite or beyond {HUGE:g}")
    return array


def _fits(found: tuple[int, ...], shape: tuple[int | None, ...]) -> bool:
    return len(found) == len(shape) and all(
        size > 0 if wanted is None else size == wanted
        for size, wanted in zip(found, shape, strict=True)
    )
