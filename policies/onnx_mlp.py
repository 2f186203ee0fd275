"""Read the layers of a multilayer perceptron from an ONNX file; its code is never run.

Exporters spell layer normalisation and SiLU out as elementary nodes; what is read here is the
network behind them, see `SUPPORTED`. Anything else is refused by name.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import onnx
from google.protobuf.message import DecodeError
from onnx import GraphProto, ModelProto, NodeProto, helper, numpy_helper

from sumo_dist.errors import SumoError
from sumo_dist.policies.network import NORM_EPSILON, Activation, Layer

SUPPORTED = (
    "a chain of Gemm (x W^T + b), each followed by a layer normalisation or none and by Elu "
    "(alpha 1), SiLU, Tanh or none, behind a normaliser (x - mean) / std or none, and before "
    "factors of the outputs or none"
)
GEMM = {"alpha": 1.0, "beta": 1.0, "transA": 0, "transB": 1}
GEMM_DEFAULTS = {"alpha": 1.0, "beta": 1.0, "transA": 0, "transB": 0}
ELU = {"alpha": 1.0}
NORM = ("ReduceMean", "Sub", "Pow", "ReduceMean", "Add", "Sqrt", "Div", "Mul", "Add")


def read_mlp(path: Path, inputs: int, outputs: int) -> tuple[Layer, ...]:
    """Read the layers of a network.

    A normaliser of the inputs becomes part of the first layer, factors of the outputs the last
    one's gain.

    Args:
        path: ONNX file.
        inputs: of the first layer.
        outputs: of the last layer.

    Returns:
        The layers, their arrays float32, contiguous, read-only.

    Raises:
        SumoError: the file is not ONNX or holds anything else than such a network.
    """
    chain = _Chain(_load(path).graph, path)
    normaliser = chain.normaliser()
    layers = []
    while chain.kind() == "Gemm":
        weight, bias = chain.gemm()
        if normaliser is not None and not layers:
            weight, bias = _behind(normaliser, weight, bias)
        norm = chain.norm()
        layers.append(Layer(_frozen(weight), _frozen(bias), chain.activation(), norm))
    if layers and (gain := chain.gain()) is not None:
        layers[-1] = layers[-1]._replace(gain=gain)
    chain.finish()
    _check_shapes(layers, inputs, outputs, path)
    return tuple(layers)


def read_metadata(path: Path) -> Mapping[str, str]:
    """Read what the exporter wrote beside the network.

    Raises:
        SumoError: the file is not ONNX.
    """
    return {entry.key: entry.value for entry in _load(path).metadata_props}


def _load(path: Path) -> ModelProto:
    try:
        return onnx.load_model(path, load_external_data=False)
    except DecodeError as error:
        raise SumoError(f"{path}: not an ONNX file: {error}") from None


class _Chain:
    """The nodes of a graph, taken one after the other; each must continue the one before."""

    def __init__(self, graph: GraphProto, path: Path) -> None:
        self._path = path
        self._arrays = {tensor.name: numpy_helper.to_array(tensor) for tensor in graph.initializer}
        for node in graph.node:
            if node.op_type == "Constant":
                self._arrays[node.output[0]] = numpy_helper.to_array(node.attribute[0].t)
        self._nodes = [node for node in graph.node if node.op_type != "Constant"]
        sources = [value.name for value in graph.input if value.name not in self._arrays]
        if len(sources) != 1 or len(graph.output) != 1:
            raise SumoError(f"{path}: one input, one output and {SUPPORTED} are supported")
        self._value, self._end = sources[0], graph.output[0].name
        self._scaled = False

    def kind(self, ahead: int = 0) -> str:
        """Operator of the next node, or of one after it; "" behind the last."""
        return self._nodes[ahead].op_type if ahead < len(self._nodes) else ""

    def normaliser(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Take (x - mean) / std and what passes all of it on; return mean and std."""
        found = None
        if (self.kind(), self.kind(1)) == ("Sub", "Div"):
            found = self._constant(self._take()), self._constant(self._take())
        while self.kind() in ("Slice", "Concat"):
            self._check_passes_all(self._take(), found)
        return found

    def gemm(self) -> tuple[np.ndarray, np.ndarray]:
        """Take a Gemm; return its weight and bias."""
        node = self._take()
        if _attributes(node, GEMM_DEFAULTS) != GEMM:
            raise SumoError(f"{self._where(node)} is not supported here, only Gemm with {GEMM}")
        if len(node.input) != 3 or not all(name in self._arrays for name in node.input[1:]):
            raise SumoError(f"{self._where(node)} must have a constant weight and a constant bias")
        weight, bias = (self._arrays[name] for name in node.input[1:])
        if weight.dtype != np.float32 or bias.dtype != np.float32:
            raise SumoError(
                f"{self._where(node)} has {weight.dtype} weights and {bias.dtype} biases, "
                "not float32"
            )
        return weight, bias

    def norm(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Take the nodes of a layer normalisation; return its scale and shift."""
        if self.kind() != "ReduceMean":
            return None
        nodes = self._nodes[: len(NORM)]
        mean, centred, power, variance, plus, root, ratio, scaled, shifted = nodes
        wired = (
            tuple(node.op_type for node in nodes) == NORM
            and list(centred.input) == [self._value, mean.output[0]]
            and power.input[0] == centred.output[0]
            and variance.input[0] == power.output[0]
            and plus.input[0] == variance.output[0]
            and root.input[0] == plus.output[0]
            and list(ratio.input) == [centred.output[0], root.output[0]]
            and scaled.input[0] == ratio.output[0]
            and shifted.input[0] == scaled.output[0]
        )
        axes = [_attributes(node, {}).get("axes") for node in (mean, variance)]
        constants = self._arrays[power.input[1]], self._arrays[plus.input[1]]
        if not wired or axes != [[-1], [-1]] or constants != (2.0, NORM_EPSILON):
            raise SumoError(
                f"{self._where(mean)} begins no layer normalisation with epsilon {NORM_EPSILON:g}; "
                f"supported is {SUPPORTED}"
            )
        self._nodes = self._nodes[len(NORM) :]
        self._value = shifted.output[0]
        return _frozen(self._constant(scaled)), _frozen(self._constant(shifted))

    def activation(self) -> Activation:
        """Take an activation, if one comes; return its name."""
        if self.kind() == "Elu":
            node = self._take()
            if _attributes(node, ELU) != ELU:
                raise SumoError(f"{self._where(node)} is not supported here, only Elu with {ELU}")
            return "elu"
        if self.kind() == "Tanh":
            self._take()
            return "tanh"
        if (self.kind(), self.kind(1)) == ("Sigmoid", "Mul"):
            sigmoid, product = self._nodes[:2]
            if sorted(product.input) == sorted([self._value, sigmoid.output[0]]):
                self._nodes = self._nodes[2:]
                self._value = product.output[0]
                return "silu"
        return "linear"

    def gain(self) -> np.ndarray | None:
        """Take the factors of the outputs, and a summand of zeros, if they come."""
        if (self.kind(), self.kind(1)) != ("Mul", "Add"):
            return None
        factors = self._constant(self._take())
        node = self._take()
        if self._constant(node).any():
            raise SumoError(f"{self._where(node)} shifts the outputs, which is not supported here")
        return _frozen(factors)

    def finish(self) -> None:
        """See that nothing follows."""
        if self._nodes:
            node = self._nodes[0]
            raise SumoError(f"{self._where(node)} is not supported here; supported is {SUPPORTED}")
        if self._value != self._end:
            raise SumoError(f"{self._path}: output {self._end!r} is not the end of the chain")

    def _take(self) -> NodeProto:
        node = self._nodes.pop(0)
        if not node.input or node.input[0] != self._value:
            raise SumoError(
                f"{self._where(node)} does not continue the chain; supported is {SUPPORTED}"
            )
        self._value = node.output[0]
        return node

    def _constant(self, node: NodeProto) -> np.ndarray:
        if len(node.input) != 2 or node.input[1] not in self._arrays:
            raise SumoError(f"{self._where(node)} must have one constant operand")
        return self._arrays[node.input[1]]

    def _check_passes_all(
        self, node: NodeProto, found: tuple[np.ndarray, np.ndarray] | None
    ) -> None:
        if node.op_type == "Concat":
            passes = len(node.input) == 1
        else:
            first, last, axis, step = (int(self._arrays[name][0]) for name in node.input[1:])
            size = found[0].shape[-1] if found else -1
            passes = (first, axis, step) == (0, 1, 1) and last == size
        if not passes:
            raise SumoError(f"{self._where(node)} drops inputs; supported is {SUPPORTED}")

    def _where(self, node: NodeProto) -> str:
        return f"{self._path}: node {node.name!r} ({node.op_type})"


def _behind(
    normaliser: tuple[np.ndarray, np.ndarray], weight: np.ndarray, bias: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """W (x - mean) / std + b as one layer, computed in float64 and rounded once."""
    mean, std = (part.astype(np.float64).ravel() for part in normaliser)
    scaled = weight / std
    return scaled.astype(np.float32), (bias - scaled @ mean).astype(np.float32)


def _attributes(node: NodeProto, defaults: Mapping[str, object]) -> dict[str, object]:
    given = {item.name: helper.get_attribute_value(item) for item in node.attribute}
    return {**defaults, **given}


def _check_shapes(layers: list[Layer], inputs: int, outputs: int, path: Path) -> None:
    size = inputs
    for index, (weight, bias, _, norm, gain) in enumerate(layers):
        if weight.ndim != 2 or weight.shape[1] != size or bias.shape != weight.shape[:1]:
            raise SumoError(
                f"{path}: layer {index} has weight {weight.shape} and bias {bias.shape} "
                f"for {size} inputs; (outputs, {size}) and (outputs,) are valid"
            )
        size = weight.shape[0]
        parts = (*(norm or ()), *(() if gain is None else (gain,)))
        if any(part.shape != (size,) or part.dtype != np.float32 for part in parts):
            raise SumoError(f"{path}: layer {index} has {size} outputs, its norm or gain does not")
    if size != outputs:
        raise SumoError(f"{path}: the network has {size} outputs, {outputs} are valid")


def _frozen(array: np.ndarray) -> np.ndarray:
    array = np.array(array, order="C")
    array.setflags(write=False)
    return array
