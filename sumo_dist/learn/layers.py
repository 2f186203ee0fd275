"""From torch to the networks that planner and workers run without it."""

import numpy as np
import torch  # pyright: ignore[reportMissingImports]
from torch import nn  # pyright: ignore[reportMissingImports]

from sumo_dist.policies.network import Activation, Layer

ACTIVATIONS: dict[type[nn.Module], Activation] = {nn.ELU: "elu", nn.Tanh: "tanh"}


def layers_of(
    network: nn.Sequential,
    mean: torch.Tensor,
    deviation: torch.Tensor,
    scale: torch.Tensor | float = 1.0,
    shift: torch.Tensor | float = 0.0,
) -> tuple[Layer, ...]:
    """Return the layers of a network whose inputs are normalised.

    Args:
        network: linear layers with an activation behind each or none.
        mean, deviation: (inputs,) of (x - mean) / deviation before it, which becomes part of the
            first layer.
        scale, shift: (outputs,) of scale y + shift behind it, which becomes part of the last layer.
    """
    layers: list[Layer] = []
    for module in network:
        if isinstance(module, nn.Linear):
            layers.append(Layer(_array(module.weight), _array(module.bias)))
        else:
            layers[-1] = layers[-1]._replace(activation=ACTIVATIONS[type(module)])
    scaled = layers[0].weight.astype(float) / _array(deviation).astype(float)
    bias = layers[0].bias - scaled @ _array(mean).astype(float)
    layers[0] = layers[0]._replace(weight=scaled.astype(np.float32), bias=bias.astype(np.float32))
    last = layers[-1]
    weight = (last.weight.T * np.asarray(scale, np.float32)).T
    bias = last.bias * np.asarray(scale, np.float32) + np.asarray(shift, np.float32)
    layers[-1] = last._replace(weight=np.ascontiguousarray(weight), bias=bias)
    return tuple(layers)


def _array(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy().astype(np.float32)
