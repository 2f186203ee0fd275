"""A training: an environment, a learner, and a folder from which it goes on when it was killed."""

import csv
import json
import pickle
import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from hashlib import sha256
from pathlib import Path
from typing import Any, Self
from zipfile import BadZipFile, ZipFile

import numpy as np
import torch  # pyright: ignore[reportMissingImports]

from sumo_dist.errors import UsageError
from sumo_dist.learn.environment import Environment, EnvironmentConfig
from sumo_dist.learn.ppo import Account, Learner
from sumo_dist.learn.ppo_config import PPOConfig
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.learned import Contract, LearnedPolicy, read_contract
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.provenance import provenance
from sumo_dist.tasks import load_task

REQUEST, PROGRESS, STATE, POLICY = "request.json", "progress.csv", "training.pt", "policy.onnx"
KEEP_EVERY = 10  # updates between two times that the training is written down


@dataclass(frozen=True)
class Request:
    """All that decides the weights, besides the code.

    Attributes:
        task: name or file.
        seed: of starts, variations and learner.
        environment: how episodes are drawn.
        ppo: settings of the learner.
        weight, param: of the task's cost, in place of its own, such as "fall=250".
        settings: of the planning model, "key=value", see `PlannerConfig`.
        engine: kind of rollout engine.
        start: SHA-256 of the state of the training that it begins with, "" if it begins anew.
    """

    task: str
    seed: int
    environment: EnvironmentConfig
    ppo: PPOConfig = field(default_factory=PPOConfig)
    weight: tuple[str, ...] = ()
    param: tuple[str, ...] = ()
    settings: tuple[str, ...] = ()
    engine: str = "auto"
    start: str = ""

    def to_json(self) -> str:
        """Return it as a text that differs if anything does."""
        return json.dumps(asdict(self), indent=1)


@dataclass
class Effort:
    """What a training has taken so far.

    Attributes:
        updates: of the policy.
        wall_s, cpu_s: time [s], that of all threads for the latter.
    """

    updates: int = 0
    wall_s: float = 0.0
    cpu_s: float = 0.0


@dataclass(frozen=True)
class _Start:
    """Another training, as one that begins with it needs it.

    Attributes:
        contract: of its policy.
        learner: the state of its learner.
        deviations: (n,) of its first actions.
    """

    contract: Contract
    learner: Mapping[str, Any]
    deviations: np.ndarray

    @classmethod
    def read(cls, folder: Path, problem: Problem, hidden: tuple[int, ...]) -> Self:
        """Read it for a training of a problem with hidden layers of these sizes.

        Raises:
            UsageError: it is damaged, or has other layers.
            PolicyError: it is of another kind of task.
        """
        contract = read_contract(folder / POLICY)
        contract.check(problem)
        ppo = PPOConfig(**contract.origin["trained"]["ppo"])
        if tuple(ppo.hidden) != hidden:
            raise UsageError(
                f"the networks in {folder} have hidden layers of {tuple(ppo.hidden)}, this "
                f"training's of {hidden}: it can begin with the same only"
            )
        deviations = ppo.deviations(problem.task.actions)
        return cls(contract, _read_state(folder)["learner"], deviations)


class Training:
    """A training and its folder; a context manager."""

    def __init__(
        self, folder: Path, request: Request, threads: int, start: Path | None = None
    ) -> None:
        """Begin, or go on from what is in the folder.

        Args:
            folder: gets request.json, progress.csv, training.pt and policy.onnx.
            request: what decides the weights.
            threads: of the rollouts; equal requests give equal bits on any number of them.
            start: folder of the training that it begins with, which the request names.

        Raises:
            UsageError: the folder holds another training or a damaged one, the training that it
                should begin with is damaged or has other layers, or the request does not fit the
                task.
            PolicyError: the training that it should begin with is of another kind of task.
        """
        _check(folder, request)
        torch.set_num_threads(1)  # sums over threads would depend on their number
        self._folder, self._request = folder, request
        task = load_task(request.task)
        planner = PlannerConfig.resolve(task.planner, settings=request.settings)
        self._problem = Problem.build(task, planning_options(planner))
        cost = task.table.adjusted(request.weight, request.param)
        for read in (request.ppo.deviations, request.ppo.standing):
            read(task.actions)  # refused before anything is begun
        state = _read_state(folder) if (folder / STATE).exists() else None
        hidden = request.ppo.hidden
        self._start = None if start is None else _Start.read(start, self._problem, hidden)
        self._environment = Environment(
            *(self._problem, cost, request.environment, request.seed, threads, request.engine)
        )
        folder.mkdir(parents=True, exist_ok=True)
        (folder / REQUEST).write_text(request.to_json())
        self._environment.stagger()
        self._learner = Learner(self._environment, request.ppo, request.seed)
        self._made_with = provenance()  # now: a checkout may change while this runs
        self.effort = Effort()
        if state is not None:
            self._restore(state)
        elif self._start is not None:
            self._learner.begin_with(self._start.learner, self._start.deviations)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._environment.__exit__()

    def run(self, updates: int, on_update: Callable[[int, Account], None]) -> None:
        """Train until there have been so many updates; an interruption loses the last few.

        Args:
            updates: of the policy, those of before included.
            on_update: is told of each, by its number.
        """
        while self.effort.updates < updates:
            wall, cpu = time.perf_counter(), time.process_time()
            account = self._learner.update()
            self.effort.updates += 1
            self.effort.wall_s += time.perf_counter() - wall
            self.effort.cpu_s += time.process_time() - cpu
            self._note(account)
            on_update(self.effort.updates, account)
            if self.effort.updates % KEEP_EVERY == 0 or self.effort.updates == updates:
                self._keep()

    @property
    def actions_per_update(self) -> int:
        """Actions of all episodes between two updates."""
        return self._request.environment.count * self._request.ppo.steps

    @property
    def policy(self) -> LearnedPolicy:
        """The policy as it is now, without noise."""
        rate, effort = self._request.environment.rate, self.effort
        actions = effort.updates * self.actions_per_update
        taken = {
            "updates": effort.updates,
            "actions": actions,
            "robot_hours": round(actions / rate / 3600, 2),
            "wall_s": round(effort.wall_s),
            "cpu_s": round(effort.cpu_s),
        }
        origin = {"trained": json.loads(self._request.to_json()), **taken, **self._made_with}
        if self._start is not None:  # what a policy has taken is all that it has taken
            before = self._start.contract.origin
            origin |= {name: round(before[name] + value, 2) for name, value in taken.items()}
            origin["began_with"] = before
        contract = Contract.of(self._problem, (0.0,), rate, origin)
        return LearnedPolicy(contract, self._learner.layers)

    def _keep(self) -> None:
        """Write down all that going on needs, and the policy as it is."""
        self.policy.save(self._folder / POLICY)
        state = {
            "effort": asdict(self.effort),
            "environment": _tensors(self._environment.state()),
            "learner": self._learner.state(),
        }
        unfinished = self._folder / f".{STATE}.unfinished"
        torch.save(state, unfinished)
        unfinished.replace(self._folder / STATE)

    def _restore(self, state: Mapping[str, Any]) -> None:
        self._environment.restore(_arrays(state["environment"]))
        self._learner.restore(state["learner"])
        self.effort = Effort(**state["effort"])
        rows = (self._folder / PROGRESS).read_text().splitlines(keepends=True)
        (self._folder / PROGRESS).write_text("".join(rows[: self.effort.updates + 1]))

    def _note(self, account: Account) -> None:
        """Add a row to the progress."""
        effort = self.effort
        row = {"update": effort.updates, "wall_s": effort.wall_s, "cpu_s": effort.cpu_s}
        row |= asdict(account)
        with (self._folder / PROGRESS).open("a", newline="") as file:
            table = csv.DictWriter(file, row.keys())
            if effort.updates == 1:
                table.writeheader()
            table.writerow({k: f"{v:.6g}" if isinstance(v, float) else v for k, v in row.items()})


def state_hash(folder: Path) -> str:
    """SHA-256 of all that a training in a folder has come to.

    Raises:
        UsageError: there is none.
    """
    missing = [name for name in (STATE, POLICY) if not (folder / name).is_file()]
    if missing:
        raise UsageError(f"{folder} holds no training to begin with: it has no {missing[0]}")
    return sha256((folder / STATE).read_bytes()).hexdigest()


def _read_state(folder: Path) -> dict[str, Any]:
    """Read what a training has come to.

    Raises:
        UsageError: the file is damaged.
    """
    try:
        with ZipFile(folder / STATE) as parts:
            whole = parts.testzip() is None  # torch does not compare the checksums
        state = torch.load(folder / STATE, weights_only=True)
        if whole and set(state) == {"effort", "environment", "learner"}:
            return state
    except (BadZipFile, OSError, RuntimeError, TypeError, ValueError, pickle.UnpicklingError):
        pass
    raise UsageError(
        f"{folder / STATE} is damaged or unreadable: restore it from a copy, or train anew"
    )


def _check(folder: Path, request: Request) -> None:
    """See that a folder is this training's, or can be."""
    file = folder / REQUEST
    if file.exists():
        if file.read_text() != request.to_json():
            raise UsageError(
                f"{folder} holds another training, see its {REQUEST}; give the same options to go "
                "on with it, or another --out"
            )
    elif folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise UsageError(f"{folder} holds something else than a training; give another --out")


def _tensors(state: Any) -> Any:
    """Return nested mappings with tensors for their arrays, as `torch.save` keeps them safely."""
    if isinstance(state, Mapping):
        return {name: _tensors(value) for name, value in state.items()}
    return torch.from_numpy(state) if isinstance(state, np.ndarray) else state


def _arrays(state: Any) -> Any:
    if isinstance(state, Mapping):
        return {name: _arrays(value) for name, value in state.items()}
    return state.numpy() if isinstance(state, torch.Tensor) else state
