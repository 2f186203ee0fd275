import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra train")

from sumo_dist.learn.layers import layers_of  # noqa: E402
from sumo_dist.policies.network import evaluate  # noqa: E402


def test_layers_compute_what_torch_does():
    torch.manual_seed(0)
    network = torch.nn.Sequential(
        torch.nn.Linear(5, 8),
        torch.nn.ELU(),
        torch.nn.Linear(8, 4),
        torch.nn.Tanh(),
        torch.nn.Linear(4, 3),
    )
    mean, deviation = torch.randn(5) * 3.0, torch.rand(5) + 0.1
    scale, shift, rows = torch.rand(3), torch.randn(3), torch.randn(20, 5) * 4.0
    with torch.inference_mode():
        expected = scale * network((rows - mean) / deviation) + shift
    found = evaluate(layers_of(network, mean, deviation, scale, shift), rows.numpy())
    np.testing.assert_allclose(found, expected.numpy(), atol=2e-5)
