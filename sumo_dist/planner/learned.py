"""Learned policies and values: their files, their contracts, and how a policy drives alone.

The file is ONNX, read by the same code as the low-level policies: no torch is needed to run it.
"""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from onnx import ModelProto, TensorProto, helper, numpy_helper, save_model

from sumo_dist.errors import PolicyError, SumoError
from sumo_dist.planner.observation import Observer
from sumo_dist.planner.problem import Problem
from sumo_dist.policies.network import Layer, evaluate
from sumo_dist.policies.onnx_mlp import read_metadata, read_mlp
from sumo_dist.timing import TICK, TICK_RATE

KEY = "sumo_dist"  # of the file's metadata under which its contract is
OPSET, IR_VERSION = 17, 8


@dataclass(frozen=True)
class Contract:
    """What a learned policy was made for; a task that it is to do must have the same.

    Attributes:
        robot: name of the robot.
        low_level: SHA-256 of the weights of the policy below it, "" if it moves the joints itself.
        inputs: name and length of each part of its inputs, see `Observer`.
        actions: names of the dimensions that it decides.
        lower, upper: their limits.
        times: (F,) of the knots that it returns, from now on [s]; one that drives alone has (0,),
            a value of states has none.
        rate: plans per second of robot time for which it was made [Hz].
        trust: (F * n,) how much of the last plan's knots a proposal's replace, from 0 to 1; none
            stands for all of it.
        origin: how it was made: task, command, seed, steps; for people.
    """

    robot: str
    low_level: str
    inputs: Mapping[str, int]
    actions: tuple[str, ...]
    lower: tuple[float, ...]
    upper: tuple[float, ...]
    times: tuple[float, ...]
    rate: int
    trust: tuple[float, ...] = ()
    origin: Mapping[str, Any] = field(default_factory=dict)

    @classmethod
    def of(
        cls, problem: Problem, times: tuple[float, ...], rate: int, origin: Mapping[str, Any]
    ) -> Self:
        """Return the contract of what is learnt on a task."""
        task, actions = problem.task, problem.task.actions
        return cls(
            robot=task.scene.robot.name,
            low_level=problem.policy.contract.weights_sha256,
            inputs=dict(Observer(task, problem.model).parts),
            actions=tuple(actions.names[i] for i in actions.searched),
            lower=tuple(actions.lower[actions.searched].tolist()),
            upper=tuple(actions.upper[actions.searched].tolist()),
            times=times,
            rate=rate,
            origin=origin,
        )

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Read what `to_json` wrote.

        Raises:
            ValueError: it is no contract.
        """
        found = json.loads(text)
        names = {f.name for f in fields(cls)}
        # older contracts have no trust, which is to trust all
        if not isinstance(found, dict) or set(found) | {"trust"} != names:
            raise ValueError(f"needs {sorted(names)}")
        lists = {name: tuple(v) for name, v in found.items() if isinstance(v, list)}
        return cls(**{**found, **lists})

    def to_json(self) -> str:
        """Return all of it as a text."""
        return json.dumps(asdict(self))

    def check(self, problem: Problem) -> None:
        """See that a policy of this contract can do a task.

        Raises:
            PolicyError: something differs; it says what.
        """
        needed = Contract.of(problem, self.times, self.rate, self.origin)
        if name := self.differing(needed):
            raise PolicyError(
                f"a learned policy whose {name.replace('_', ' ')} is {getattr(self, name)} "
                f"cannot do task {problem.task.name!r}: there it is {getattr(needed, name)}"
            )

    def differing(self, other: "Contract") -> str:
        """Name a field in which two contracts differ, "" if one policy can have both."""
        names = (f.name for f in fields(self) if f.name not in ("trust", "origin"))
        return next((n for n in names if getattr(self, n) != getattr(other, n)), "")


@dataclass(frozen=True, eq=False)  # weights have no cheap equality
class LearnedNetwork:
    """A network over observations, in a file with its contract.

    Attributes:
        contract: what it was made for.
        layers: of the network.
    """

    contract: Contract
    layers: tuple[Layer, ...]
    _kind: ClassVar[str]

    @classmethod
    def load(cls, path: Path) -> Self:
        """Read a file.

        Raises:
            PolicyError: there is no such file, it holds nothing that was learnt or the other kind,
                or another network than its contract says.
        """
        contract = read_contract(path)
        outputs = cls._outputs(contract)
        if not outputs:
            raise PolicyError(f"{path} holds no {cls._kind}")
        try:
            return cls(contract, read_mlp(path, sum(contract.inputs.values()), outputs))
        except SumoError as error:
            raise PolicyError(str(error)) from None

    def save(self, path: Path) -> None:
        """Write it to a file; one that is there is replaced at once or not at all."""
        unfinished = path.with_name(f".{path.name}.unfinished")
        save_model(self._model(), unfinished)
        unfinished.replace(path)

    def _model(self) -> ModelProto:
        nodes, arrays, value = [], [], "observation"
        for i, layer in enumerate(self.layers):
            names = f"weight{i}", f"bias{i}"
            arrays += map(numpy_helper.from_array, (layer.weight, layer.bias), names)
            nodes.append(helper.make_node("Gemm", [value, *names], [f"sum{i}"], transB=1))
            value = f"sum{i}"
            if layer.activation != "linear":
                kind = {"elu": "Elu", "tanh": "Tanh"}[layer.activation]
                nodes.append(helper.make_node(kind, [value], [f"value{i}"]))
                value = f"value{i}"
        sizes = self.layers[0].weight.shape[1], self.layers[-1].weight.shape[0]
        ends = [
            helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", size])
            for name, size in zip(("observation", value), sizes, strict=True)
        ]
        graph = helper.make_graph(nodes, "learned", ends[:1], ends[1:], arrays)
        model = helper.make_model(
            graph, opset_imports=[helper.make_opsetid("", OPSET)], ir_version=IR_VERSION
        )
        helper.set_model_props(model, {KEY: self.contract.to_json()})
        return model

    @classmethod
    def _outputs(cls, contract: Contract) -> int:
        """Number of outputs that a contract asks for; 0 if it is one of another kind of network."""
        raise NotImplementedError


class LearnedPolicy(LearnedNetwork):
    """A network from observations to knots of normalised actions: F knots of n actions each."""

    _kind = "policy"

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        """Return knots (B, F, n) in [-1, 1] for observations (B, size) float32."""
        knots = evaluate(self.layers, observations.astype(np.float32))
        shape = len(self.contract.times), len(self.contract.actions)
        return np.clip(knots, -1.0, 1.0).reshape(-1, *shape).astype(float)

    @classmethod
    def _outputs(cls, contract: Contract) -> int:
        return len(contract.times) * len(contract.actions)


class LearnedValue(LearnedNetwork):
    """A network from observations to the cost that is to come; its contract has no knots."""

    _kind = "value of states"

    def __call__(self, observations: np.ndarray) -> np.ndarray:
        """Return costs (B,), not negative, for observations (B, size) float32."""
        costs = evaluate(self.layers, observations.astype(np.float32))
        return np.maximum(costs[:, 0], 0.0).astype(float)

    @classmethod
    def _outputs(cls, contract: Contract) -> int:
        return 0 if contract.times else 1


def read_contract(path: Path) -> Contract:
    """Read what a policy's file says of itself.

    Raises:
        PolicyError: there is no such file, or it holds no learned policy.
    """
    try:
        path.open("rb").close()
        text = read_metadata(path).get(KEY)
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise PolicyError(f"cannot read policy file {path} on this host: {reason}") from None
    except SumoError as error:
        raise PolicyError(str(error)) from None
    if text is None:
        raise PolicyError(
            f"{path}: not made by `sumo-dist train` or `sumo-dist distil`: it has no contract"
        )
    try:
        return Contract.from_json(text)
    except (TypeError, ValueError) as error:
        raise PolicyError(f"{path}: its contract is of another version: {error}") from None


def driving(path: Path) -> dict[str, Any]:
    """Return planner settings under which a learned policy alone drives the robot.

    Its action is the only candidate, held until the next plan; the rollout tells what it costs.

    Raises:
        PolicyError: there is no such file, or it holds no learned policy.
    """
    rate = read_contract(path).rate
    return {
        "optimizer": "ps",
        "rollouts": 1,
        "iterations": 1,
        "nodes": 1,
        "spline": "zero",
        "horizon": (TICK_RATE // rate + 1) * TICK,  # at least until the next plan
        "rate": rate,
        "execute": "mean",
        "guidance": "learned",
        "policy": str(path),
        "guided": 1.0,
    }
