"""`sumo-dist train`: reinforcement learning of a policy over a task's actions."""

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from sumo_dist.errors import UsageError
from sumo_dist.extras import need
from sumo_dist.learn.environment import EnvironmentConfig
from sumo_dist.learn.ppo_config import PPOConfig
from sumo_dist.model.variation import Spread
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.provenance import cores
from sumo_dist.startup import INTERRUPTED
from sumo_dist.tasks import load_task, task_source
from sumo_dist.terminal import say

if TYPE_CHECKING:
    from sumo_dist.learn.ppo import Account
    from sumo_dist.learn.train import Request, Training

SAY_EVERY_S = 10.0
LIMITS = {
    "updates": (1, 10**7),
    "envs": (1, 10**5),
    "models": (1, 4096),
    "kl": (0.0, 1.0),
    "entropy": (0.0, 1.0),
    "scatter": (0.0, 100.0),  # [m]
    "time_limit": (0.1, 3600.0),  # [s]
    "seed": (0, 2**31 - 1),
}


@dataclass(frozen=True, kw_only=True)
class Options:
    """Options of `train`.

    Attributes:
        task: its name, or the path of its file.
        out: folder of the training; one that was killed goes on from it. It gets policy.onnx, for
            `sumo-dist run --policy-file`.
        updates: of the policy, after which it ends; more may be asked for later.
        start: folder of another training, whose policy this one begins with; the noise is anew. It
            must stay as it is.
        seed: of starts, variations and learner.
        envs: episodes at a time.
        time_limit: of an episode [s]; by default the task's.
        mass, size, friction: largest relative deviations of objects and ground, drawn evenly.
        scatter: up to how far starts are moved on the floor, robot and objects together [m], as if
            the goal were elsewhere: so the robot is not always between it and the object.
        models: that have such deviations, among which the episodes are spread.
        running: cost terms that are paid per second, such as those of a gait; of the others a
            reward is what they change by.
        noise: of the first actions whose names begin so, over what it would be, such as arm=0.1.
        stand: of the first actions, in place of the task's of a robot that stands, in the action's
            unit, such as arm_sh1=-0.3.
        kl: by how much an update should change the policy (mean KL divergence of its actions),
            which the learning rate follows; 0 keeps the rate.
        entropy: weight of the policy's entropy in what it learns.
        weight: weights of cost terms in place of the task's, such as fall=250.
        param: the task's parameters, such as goal=1,0.
        set: planner settings as key=value; here the planning model's count, and rate: actions per
            second of robot time.
        threads: of the rollouts; by default one for each core. A seed trains the same weights on
            any number of them.
        engine: auto, native, native-portable or fallback.
    """

    task: Annotated[str, tyro.conf.Positional]
    out: Path
    updates: int = 1000
    start: Path | None = None
    seed: int = 1
    envs: int = 512
    time_limit: float | None = None
    mass: float = 0.0
    size: float = 0.0
    friction: float = 0.0
    scatter: float = 0.0
    models: int = 64
    running: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    noise: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    stand: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    kl: float = PPOConfig.kl
    entropy: float = PPOConfig.entropy
    weight: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    param: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    set: Annotated[tuple[str, ...], tyro.conf.UseAppendAction] = ()
    threads: int | None = None
    engine: str = "auto"

    def __post_init__(self) -> None:
        for name, (least, most) in LIMITS.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                option = name.replace("_", "-")
                raise UsageError(f"--{option} must be from {least} to {most}, got {value}")
        for name in ("mass", "size", "friction"):
            if not 0.0 <= getattr(self, name) < 1.0:
                raise UsageError(f"--{name} must be at least 0 and below 1: a relative deviation")
        if self.threads is not None and self.threads < 1:
            raise UsageError(f"--threads must be at least 1, got {self.threads}")

    @property
    def environment(self) -> EnvironmentConfig:
        """How episodes are drawn."""
        spread = Spread(mass=self.mass, size=self.size, friction=self.friction)
        task = load_task(self.task)
        return EnvironmentConfig(
            count=self.envs,
            rate=PlannerConfig.resolve(task.planner, settings=self.set).rate,
            time_limit=task.time_limit if self.time_limit is None else self.time_limit,
            models=self.models if spread != Spread() else 0,
            spread=spread,
            scatter=self.scatter,
            running=self.running,
        )

    @property
    def request(self) -> "Request":
        """All that decides the weights; it needs torch."""
        from sumo_dist.learn.train import Request, state_hash

        return Request(
            task=task_source(self.task),
            seed=self.seed,
            environment=self.environment,
            ppo=PPOConfig(noise=self.noise, stand=self.stand, kl=self.kl, entropy=self.entropy),
            weight=self.weight,
            param=self.param,
            settings=self.set,
            engine=self.engine,
            start="" if self.start is None else state_hash(self.start),
        )


def main(options: Options) -> int:
    """Train until there are enough updates; 130 if interrupted, which loses the last few."""
    need("train", "sumo-dist train")
    from sumo_dist.learn.train import Training

    threads = cores() if options.threads is None else options.threads
    with Training(options.out, options.request, threads, options.start) as training:
        if training.effort.updates:
            say(f"{options.out} has {training.effort.updates} updates; it goes on")
        try:
            training.run(options.updates, _Teller(training, options.updates))
        except KeyboardInterrupt:
            say(f"interrupted; the same command goes on from what is in {options.out}")
            return INTERRUPTED
    say(f"wrote {options.out / 'policy.onnx'}: sumo-dist run {options.task} --policy-file FILE")
    return 0


class _Teller:
    """Says now and then how the training goes."""

    def __init__(self, training: "Training", updates: int) -> None:
        self._training, self._updates = training, updates
        self._said = 0.0

    def __call__(self, update: int, account: "Account") -> None:
        now = time.monotonic()
        if now - self._said < SAY_EVERY_S and update < self._updates:
            return
        self._said = now
        ended = max(account.ended, 1)
        say(
            f"[{update}/{self._updates}, {update * self._training.actions_per_update / 1e6:.2f} M "
            f"actions, {self._training.effort.wall_s:.0f} s] cost {account.cost:.1f}, of "
            f"{account.ended} episodes {account.solved / ended:.0%} solved, "
            f"{account.fell / ended:.0%} fell, noise {account.deviation:.0%}"
        )
