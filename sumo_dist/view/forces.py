"""Who presses on whom while a plan is followed."""

import mujoco
import numpy as np

from sumo_dist.model.index import label
from sumo_dist.view.foresight import Ahead


class Forces:
    """Contact forces along a rollout, summed over who touches whom.

    They are those of the model that was rolled out, under the joint targets that were applied:
    not measured ones.

    Attributes:
        pairs: what touches what, in the order of the numbers.
    """

    MOST = 6  # pairs

    def __init__(self, model: mujoco.MjModel, base: str) -> None:
        """Find what can touch what; `base` is the robot's first body."""
        self._model, self._data = model, mujoco.MjData(model)
        robot = int(model.body_rootid[model.body(base).id])
        moving = model.body_rootid[model.body_weldid != 0]
        things = [int(body) for body in np.unique(moving) if body != robot]
        floor = 0  # with all that is fixed to the world
        found = [(robot, floor), *((robot, thing) for thing in things)]
        found += [(thing, floor) for thing in things]
        self._slots = {frozenset(pair): i for i, pair in enumerate(found[: self.MOST])}
        names = {floor: "floor", robot: "robot", **{i: label(model, "body", i) for i in things}}
        self.pairs = tuple(f"{names[one]} on {names[other]}" for one, other in found[: self.MOST])

    def along(self, ahead: Ahead, steps: int) -> np.ndarray:
        """Normal forces (steps, pairs) after each of the first steps [N]."""
        forces = np.zeros((min(steps, len(ahead.states)), len(self.pairs)))
        for state, targets, row in zip(ahead.states, ahead.targets, forces, strict=False):
            self._add(state, targets, row)
        return forces

    def _add(self, state: np.ndarray, targets: np.ndarray, row: np.ndarray) -> None:
        model, data = self._model, self._data
        data.qpos[:], data.qvel[:] = np.split(state, [model.nq])
        data.ctrl[:] = targets
        mujoco.mj_forward(model, data)
        bodies = model.geom_bodyid[data.contact.geom]  # (contacts, 2)
        roots = np.where(model.body_weldid[bodies] == 0, 0, model.body_rootid[bodies])
        force = np.empty(6)
        for i, pair in enumerate(roots):
            slot = self._slots.get(frozenset(pair.tolist()))
            if slot is not None and pair[0] != pair[1]:
                mujoco.mj_contactForce(model, data, i, force)
                row[slot] += force[0]
