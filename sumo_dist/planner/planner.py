"""One planning iteration (paper, Algorithm 1): shift, sample, roll out, update."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from sumo_dist.costs.table import CostSettings
from sumo_dist.math import splines
from sumo_dist.optim import Belief, coloring, make_optimizer, noise_ramp, noise_shares, sample
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.evaluate import Evaluation
from sumo_dist.planner.guidance import Guide
from sumo_dist.planner.plan import Plan
from sumo_dist.robots.robot import ActionSpace
from sumo_dist.timing import TICK


@dataclass(frozen=True)
class PlanRequest:
    """Where a plan starts.

    Attributes:
        number: of the plan that is asked for.
        tick: policy tick of the state; the plan is anchored there.
        state: (nq + nv,) before that tick's policy evaluation.
        memory: (nm,) float32 policy memory of the same instant.
        previous: the plan that is being followed, None at the start.
        cost: weights and parameters of its cost.
    """

    number: int
    tick: int
    state: np.ndarray
    memory: np.ndarray
    previous: Plan | None
    cost: CostSettings


@dataclass(frozen=True)
class PlanResult:
    """A plan and what it was chosen from.

    Attributes:
        plan: the new plan.
        evaluation: of the last iteration's candidates; row 0 is the unperturbed mean, or, where
            all candidates are proposals, the proposal.
        cost: weights and parameters that it was made with.
        failed: no candidate had a finite cost; the plan is the shifted previous one.
    """

    plan: Plan
    evaluation: Evaluation
    cost: CostSettings
    failed: bool


Evaluate = Callable[[PlanRequest, int, np.ndarray], Evaluation]
"""(request, iteration, knots (B, K, n)) -> evaluation of the B candidates, wherever they run."""


class Planner:
    """Algorithm 1 for one task. Keeps nothing between plans: seed and request decide the result.

    The paper's symbols: a, the action (a spline through knots, in normalised units); mu and sigma,
    mean and scale of the noise over its knots; g, the map to the policy's command; J, the cost of
    a rollout s' = f(s, policy(s, g(a))).
    """

    def __init__(
        self, config: PlannerConfig, actions: ActionSpace, seed: int, guide: Guide | None = None
    ) -> None:
        """Set up for an action space; noise is keyed by (seed, plan number, iteration).

        Args:
            config: the settings.
            actions: what is searched.
            seed: of the noise.
            guide: proposes candidates, see `guidance.make_guide`; None: all of them are drawn.
        """
        self.config = config
        self._guide = guide
        self._actions = actions
        self._seed = seed
        self._optimizer = make_optimizer(config.optimizer, config.elites, config.temperature)
        self._node_times = splines.knot_times(config.spline, config.nodes, config.horizon)
        self._smooth = config.spline == "smooth"
        self._sigma = self._noise()
        self._coloring = coloring(config.noise_exponent, len(self._sigma))

    @property
    def search(self) -> tuple[np.ndarray, np.ndarray]:
        """Times (F,) of the knots that are searched [s], and the noise's deviations (F, n) there.

        The deviations are of the first iteration, in normalised actions.
        """
        return self._node_times[-len(self._sigma) :], self._sigma

    def plan(
        self, request: PlanRequest, evaluate: Evaluate, rollouts: int | None = None
    ) -> PlanResult:
        """Run the iterations of one plan; `rollouts` takes the place of the configured number."""
        config = self.config if rollouts is None else replace(self.config, rollouts=rollouts)
        shifted = self.shifted(request)
        belief = Belief(shifted[-len(self._sigma) :], self._sigma)  # mu: the last plan, shifted
        best, lowest, evaluation = belief.mean, np.inf, None
        for iteration, count in enumerate(config.populations):
            rng = self._rng(request.number, iteration)
            shares = noise_shares(config.placement, count)  # (B,)
            # a ~ N(mu, sigma^2); (B, F, n)
            around = belief
            if iteration == 0:
                around, shares = self._propose(request, belief, shares)
            drawn = sample(around, count, rng, self._coloring, shares)
            knots = self._after(shifted[0], drawn).astype(np.float32)  # (B, K, n)
            evaluation = evaluate(request, iteration, knots)  # roll out f(s, policy(s, g(a)))
            costs = evaluation.costs(request.cost.weights)  # J; (B,)
            belief = self._optimizer.update(belief, drawn, costs)  # CEM: mu is the elites' mean
            row = int(np.argmin(costs))
            if costs[row] < lowest:
                best, lowest = drawn[row], costs[row]
        assert evaluation is not None, "there is at least one iteration"
        chosen = best if self.config.execute == "best" else belief.mean
        failed = not np.isfinite(lowest)
        knots = self._after(shifted[0], np.clip(chosen, -1.0, 1.0)[None])[0].astype(np.float32)
        # followed until the next one comes
        plan = Plan(request.number, request.tick, knots, config.horizon, config.spline)
        return PlanResult(plan, evaluation, request.cost, failed)

    def shifted(self, request: PlanRequest) -> np.ndarray:
        """Knots (K, n) of the previous plan at the new node times; at first, stand and wait."""
        if request.previous is None:
            default = self._actions.unit(self._actions.default)
            return np.repeat(default[None], self.config.nodes, axis=0)
        elapsed = self._node_times + (request.tick - request.previous.tick) * TICK
        knots = request.previous.at_times(elapsed)
        return self._after(knots[0], knots[None, -len(self._sigma) :])[0]

    def _propose(
        self, request: PlanRequest, belief: Belief, shares: np.ndarray
    ) -> tuple[Belief, np.ndarray]:
        """Let the last candidates be drawn around what the guide proposes.

        The first of them is exact, but for a learned policy's beside others: that is calmer than
        all that have noise, and where no candidate comes further it would win every time.
        What is not searched stays as in the last plan, shifted.

        Args:
            request: where the plan starts.
            belief: what all others are drawn from.
            shares: (B,) of the noise that each candidate has.

        Returns:
            What is drawn from, with a mean of each candidate, and their shares of the noise.
        """
        candidates, guided = len(shares), self.config.guided
        count = min(max(1, round(guided * candidates)), candidates - 1)  # row 0 is the last plan
        if guided == 1.0:
            count = candidates
        if self._guide is None or count == 0:
            return belief, shares
        proposal = self._guide(request.state, request.cost.parameters, belief.mean)  # (F, n)
        means = np.repeat(belief.mean[None], candidates, axis=0)  # (B, F, n)
        means[-count:] = np.where(belief.sigma > 0.0, proposal, belief.mean)
        shares = shares.copy()
        if self.config.guidance != "learned" or count == candidates:
            shares[-count] = 0.0
        return Belief(means, belief.sigma), shares

    def _noise(self) -> np.ndarray:
        """Standard deviations (F, n) of the knots from the start on."""
        config, base = self.config, self._actions.base
        ahead = int((self._node_times >= 0.0).sum())
        sigma = noise_ramp(config.variance_first, config.variance_last, ahead, self._actions.size)
        sigma *= self._actions.noise[self._actions.searched]
        sigma[:, base] *= config.base_noise
        if self._smooth:
            sigma[0, ~base] = 0.0
        return sigma

    def _after(self, before: np.ndarray, drawn: np.ndarray) -> np.ndarray:
        """Complete knots (B, F, n) from the start on by those before it; (B, K, n).

        A limb's target goes on as it moved: its knot before the start is that of the plan before,
        (n,). A velocity of the base starts anew, on the line to its next knot: the gait smooths it.
        """
        if not self._smooth:
            return drawn
        lead, drawn = TICK / self._node_times[2], drawn.astype(float)
        anew = np.clip(drawn[:, 0] - lead * (drawn[:, 1] - drawn[:, 0]), -1.0, 1.0)
        first = np.where(self._actions.base, anew, before)
        return np.concatenate([first[:, None], drawn], axis=1)

    def _rng(self, number: int, iteration: int) -> np.random.Generator:
        bits = np.random.Philox(key=[self._seed, number], counter=[0, 0, 0, iteration])
        return np.random.Generator(bits)
