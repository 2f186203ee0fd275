"""The engine that needs no compiler: `mujoco.batch` for physics, numpy for the policy."""

import hashlib
import platform
from collections.abc import Sequence
from pathlib import Path

import mujoco
import numpy as np
from mujoco.batch import Batch, SimulationError

from sumo_dist.errors import UsageError
from sumo_dist.model.frames import FrameRef
from sumo_dist.model.variation import Variation
from sumo_dist.policies import network
from sumo_dist.policies.policy import Policy
from sumo_dist.rollout.base import DIVERGED, HUGE, Request, RolloutEngine
from sumo_dist.rollout.interface import Rollouts

CHUNK = 32  # rows that are simulated at a time


def identity() -> tuple[str, str]:
    """Return the engine's name and build."""
    sources = b"".join(Path(source).read_bytes() for source in (__file__, network.__file__))
    source = hashlib.sha256(sources).hexdigest()[:12]
    versions = f"mujoco{mujoco.__version__}-numpy{np.__version__}"
    return "fallback", f"{source}-numpy-{versions}-{platform.machine()}"


class FallbackEngine(RolloutEngine):
    """Rollouts in chunks of rows; a policy's `step` does not mix rows, nor does `mujoco.batch`."""

    def __init__(
        self,
        model: mujoco.MjModel,
        policy: Policy,
        frames: tuple[FrameRef, ...],
        threads: int,
        variations: Sequence[Variation] = (),
    ) -> None:
        super().__init__(model, policy, frames, threads, variations)
        self.name, self.build = identity()
        batch = Batch(self._model, CHUNK, threads)
        fields = {"site": ("site_xpos", "site_xmat"), "body": ("xpos", "xmat")}
        self._sources = [
            tuple(batch.bind(field)[:, index] for field in fields[kind])
            for kind, index in self._frame_ids
        ]
        self._batch: Batch | None = batch

    def close(self) -> None:
        """Stop the engine's threads and free its simulations; harmless when repeated."""
        self._sources = []
        self._batch = None

    def _roll_out(self, request: Request, out: Rollouts) -> None:
        if self._batch is None:
            raise UsageError("this rollout engine is closed")
        out.memory[:] = request.memories
        out.valid[:] = True
        starts = np.broadcast_to(request.starts, (len(out.valid), request.starts.shape[1]))
        for first in range(0, len(out.valid), CHUNK):
            rows = slice(first, first + CHUNK)
            part = Rollouts(
                states=out.states[rows],
                targets=out.targets[rows],
                positions=out.positions[rows],
                rotations=out.rotations[rows],
                memory=out.memory[rows],
                valid=out.valid[rows],
            )
            self._choose(self._batch, request.models[rows])
            self._batch.state[: len(part.valid)] = starts[rows]
            self._roll_out_chunk(self._batch, request.commands[rows], part)

    def _choose(self, batch: Batch, models: np.ndarray) -> None:
        """Give each of a chunk's rows its model."""
        if len(self._models) > 1:
            idle = [self._model] * (CHUNK - len(models))
            batch.set_models([*(self._models[i] for i in models), *idle])

    def _roll_out_chunk(self, batch: Batch, commands: np.ndarray, out: Rollouts) -> None:
        rows, ticks = commands.shape[:2]
        batch.warning[:, DIVERGED, 1] = 1  # MuJoCo logs only a counter's first increment
        qpos, qvel, ctrl = batch.bind("qpos"), batch.bind("qvel"), batch.bind("ctrl")
        for tick in range(ticks):
            live = np.flatnonzero(out.valid)
            ctrl[live], out.memory[live] = self._policy.step(
                qpos[live], qvel[live], commands[live, tick], out.memory[live]
            )
            for substep in range(self._substeps):
                healthy = _step(batch, live)
                # A step leaves frames of the state it started from: those of the last row.
                if substep == 0 and tick > 0:
                    self._record_frames(live, tick - 1, out)
                out.valid[live] = healthy
                live = live[healthy]
            out.states[:, tick] = np.concatenate((qpos, qvel), axis=-1)[:rows]
            out.targets[:, tick] = ctrl[:rows]
            _invalidate(tick, out)
            if not len(live):
                return
        live = np.flatnonzero(out.valid)
        batch.forward(live, int(mujoco.mjtStage.mjSTAGE_POS))
        self._record_frames(live, ticks - 1, out)

    def _record_frames(self, live: np.ndarray, tick: int, out: Rollouts) -> None:
        for frame, (position, rotation) in enumerate(self._sources):
            out.positions[live, tick, frame] = position[live]
            out.rotations[live, tick, frame] = rotation[live].reshape(-1, 3, 3)


def _step(batch: Batch, live: np.ndarray) -> np.ndarray:
    """Advance these rows by one physics step; return which of them did not diverge."""
    failed = np.empty(0, np.intp)
    if len(live):
        try:
            batch.step(live)
        except SimulationError as error:
            failed = error.ids
    values = np.concatenate((batch.bind("qpos")[live], batch.bind("qvel")[live]), axis=-1)
    sane = np.all(np.abs(values) <= HUGE, axis=-1)
    warned = np.any(batch.warning[live][:, DIVERGED, 1] != 1, axis=-1)
    return sane & ~warned & ~np.isin(live, failed)


def _invalidate(tick: int, out: Rollouts) -> None:
    """Blank the rows that are not valid, from this tick on."""
    for array in (out.states, out.targets, out.positions, out.rotations):
        array[~out.valid, tick:] = np.nan
    out.memory[~out.valid] = np.nan
