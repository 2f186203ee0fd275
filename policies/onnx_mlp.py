"""Read the layers of a multilayer perceptron from an ONNX file; its code is never run."""

from pathlib import Path

import numpy as np
import onnx
from google.protobuf.message import DecodeError
from onnx import NodeProto, helper, numpy_helper

from sumo_dist.errors import SumoError
from sumo_dist.policies.policy import Layer

SUPPORTED = "a chain of Gemm (x W^T + b) with Elu (alpha 1) between them"
GEMM = {"alpha": 1.0, "beta": 1.0, "transA": 0, "transB": 1}
GEMM_DEFAULTS = {"alpha": 1.0, "beta": 1.0, "transA": 0, "transB": 0}
ELU = {"alpha": 1.0}


def read_mlp(path: Path, inputs: int, outputs: int) -> tuple[Layer, ...]:
    """Read the weights of an ELU network with linear output.

    Args:
        path: ONNX file.
        inputs: of the first layer.
        outputs: of the last layer.

    Returns:
        (W, b) of each layer, W (outputs, inputs) and b (outputs,), float32, contiguous, read-only.

    Raises:
        SumoError: the file is not ONNX or holds anything else than such a network.
    """
    try:
        graph = onnx.load_model(path, load_external_data=False).graph
    except DecodeError as error:
        raise SumoError(f"{path}: not an ONNX file: {error}") from None
    tensors = {tensor.name: tensor for tensor in graph.initializer}
    arrays = {name: numpy_helper.to_array(tensor) for name, tensor in tensors.items()}
    sources = [value.name for value in graph.input if value.name not in arrays]
    if len(sources) != 1 or len(graph.output) != 1 or len(graph.node) % 2 == 0:
        raise SumoError(f"{path}: one input, one output and {SUPPORTED} are supported")

    layers = []
    value = sources[0]
    for index, node in enumerate(graph.node):
        where = f"{path}: node {node.name!r} ({node.op_type})"
        if not node.input or node.input[0] != value:
            raise SumoError(f"{where} does not continue the chain; supported is {SUPPORTED}")
        if index % 2:
            _check_elu(node, where)
        else:
            layers.append(_gemm(node, arrays, where))
        value = node.output[0]
    if value != graph.output[0].name:
        raise SumoError(f"{path}: output {graph.output[0].name!r} is not the end of the chain")
    _check_shapes(layers, inputs, outputs, path)
    return tuple(layers)


def _check_elu(node: NodeProto, where: str) -> None:
    if node.op_type != "Elu" or _attributes(node, ELU) != ELU:
        raise SumoError(f"{where} is not supported here, only Elu with {ELU}")


def _gemm(node: NodeProto, arrays: dict[str, np.ndarray], where: str) -> Layer:
    if node.op_type != "Gemm" or _attributes(node, GEMM_DEFAULTS) != GEMM:
        raise SumoError(f"{where} is not supported here, only Gemm with {GEMM}")
    if len(node.input) != 3 or not all(name in arrays for name in node.input[1:]):
        raise SumoError(f"{where} must have a constant weight and a constant bias")
    weight, bias = (arrays[name] for name in node.input[1:])
    if weight.dtype != np.float32 or bias.dtype != np.float32:
        raise SumoError(f"{where} has {weight.dtype} weights and {bias.dtype} biases, not float32")
    return _frozen(weight), _frozen(bias)


def _attributes(node: NodeProto, defaults: dict[str, float]) -> dict[str, float]:
    given = {item.name: helper.get_attribute_value(item) for item in node.attribute}
    return {**defaults, **given}


def _check_shapes(layers: list[Layer], inputs: int, outputs: int, path: Path) -> None:
    size = inputs
    for index, (weight, bias) in enumerate(layers):
        if weight.ndim != 2 or weight.shape[1] != size or bias.shape != weight.shape[:1]:
            raise SumoError(
                f"{path}: layer {index} has weight {weight.shape} and bias {bias.shape} "
                f"for {size} inputs; (outputs, {size}) and (outputs,) are valid"
            )
        size = weight.shape[0]
    if size != outputs:
        raise SumoError(f"{path}: the network has {size} outputs, {outputs} are valid")


def _frozen(array: np.ndarray) -> np.ndarray:
    array = np.array(array, order="C")
    array.setflags(write=False)
    return array
