"""The newest plan's knots and how far the optimizer searches around them."""

import numpy as np

from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.planner import Planner
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.view.charts import Chart, Curve
from sumo_dist.view.marks import line_color
from sumo_dist.view.outputs import Outputs

KNOTS = Chart("charts/knots", "s")

_MOST = 1.25  # of the axis; actions lie in [-1, 1]
_APART = 0.012  # of the horizon, between bars at one knot
_OTHERS = (120, 126, 138)


class SearchLog:
    """Draws each searched velocity of the base with the noise at its knots, the limbs in grey."""

    def __init__(self, out: Outputs, actions: ActionSpace, settings: PlannerConfig) -> None:
        """Draw for settings until others follow."""
        self._out, self._actions = out, actions
        self.follow(settings)

    def follow(self, settings: PlannerConfig) -> None:
        """Take up other settings."""
        self._horizon = settings.horizon
        self._times, self._sigma = Planner(settings, self._actions, seed=0).search

    def show(self, plan: Plan) -> None:
        """Draw a plan at its tick; one of other settings is left out."""
        knots = plan.knots[-len(self._times) :]
        if knots.shape != self._sigma.shape or plan.horizon != self._horizon:
            return
        base, names = self._actions.base, self._actions.names
        limbs = np.flatnonzero(~base)
        curves = [Curve("", self._times, knots[:, i], _OTHERS, thin=True) for i in limbs]
        if len(limbs):
            middle, widest = knots[:, limbs].mean(axis=1), self._sigma[:, limbs].max(axis=1)
            curves.append(Curve("limbs, mean", self._times, middle, _OTHERS, widest))
        for line, i in enumerate(np.flatnonzero(base)):
            x = np.minimum(self._times + (line + 1) * _APART * self._horizon, self._horizon)
            name = names[self._actions.searched[i]]
            curves.append(Curve(name, x, knots[:, i], line_color(line), self._sigma[:, i]))
        KNOTS.log(self._out, plan.tick, curves, self._horizon, (-_MOST, _MOST))
