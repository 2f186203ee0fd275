"""A store of starts for training: each is drawn once by the task's reset, then used again."""

import numpy as np

from sumo_dist.episode.assemble import draw_start
from sumo_dist.model.index import StateIndex
from sumo_dist.model.variation import Variation
from sumo_dist.planner.problem import Problem


class Starts:
    """States in which episodes begin, on each of the models that they may run on."""

    def __init__(
        self,
        problem: Problem,
        seeds: range,
        parameters: np.ndarray,
        models: tuple[Variation, ...],
        scatter: float = 0.0,
    ) -> None:
        """Draw none yet: each is drawn when it is first used.

        Args:
            problem: the task, compiled.
            seeds: one for each start, as of `run --seed`.
            parameters: (n,) of the task.
            models: variations of the problem's model; model 0 is the problem's own.
            scatter: up to how far robot and objects are moved together on both axes [m], as if the
                goal were elsewhere.
        """
        index, robot = StateIndex(problem.model), problem.task.scene.robot
        self._task, self._seeds, self._parameters = problem.task, seeds, parameters
        self._states = np.full((len(seeds), index.nq + index.nv), np.nan)
        self._scatter = scatter
        self._floor = np.array([[0, 1]]) + [[index.pose(b).start] for b in index.free_bodies]
        self._heights = [index.pose(b).start + 2 for b in index.free_bodies if b != robot.base]
        bodies = [problem.model.body(b).id for b in index.free_bodies if b != robot.base]
        sizes = [np.ones(len(bodies)), *(variation.size[bodies] for variation in models)]
        self._sizes = np.array(sizes).reshape(len(models) + 1, len(bodies))

    def draw(self, count: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Return `count` states (count, nq + nv) and the numbers of their models, (count,).

        An object of another size stands higher or lower, so that it rests on the floor.
        """
        chosen = rng.integers(len(self._states), size=count)
        for start in np.unique(chosen[np.isnan(self._states[chosen, 0])]):
            self._states[start] = draw_start(self._task, self._seeds[start], self._parameters)
        states = self._states[chosen]
        models = rng.integers(len(self._sizes), size=count)
        states[:, self._heights] *= self._sizes[models]
        if self._scatter:
            away = rng.uniform(-self._scatter, self._scatter, (count, 1, 2))
            states[:, self._floor] += away
        return states, models
