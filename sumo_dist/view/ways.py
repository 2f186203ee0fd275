"""The ways of what moves in a run, as they are drawn on the floor."""

from collections.abc import Iterable

import numpy as np

from sumo_dist.episode.referee import Referee
from sumo_dist.record.world import World
from sumo_dist.view.marks import way_colors


def ways(world: World, states: Iterable[np.ndarray]) -> dict[str, np.ndarray]:
    """Return where robot and objects are in some states (nq + nv,), (states, 3) each [m]."""
    referee = Referee(world.task, world.model)
    views = [referee.view(state) for state in states]
    return {name: np.array([v[name].pos[0, 0] for v in views]) for name in way_colors(world.task)}
