import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from sumo_dist.errors import SumoError
from sumo_dist.policies.onnx_mlp import read_mlp

W0, B0 = np.arange(6, dtype=np.float32).reshape(2, 3), np.array([1, -1], np.float32)
W1, B1 = np.array([[2, 5]], np.float32), np.array([3], np.float32)


def gemm(source, target, weight, bias, **attributes):
    return helper.make_node("Gemm", [source, weight, bias], [target], **{"transB": 1, **attributes})


def elu(source, target, **attributes):
    return helper.make_node("Elu", [source], [target], name="bend", **attributes)


CHAIN = (gemm("x", "a", "W0", "B0"), elu("a", "b"), gemm("b", "y", "W1", "B1"))


def write(path, nodes=CHAIN, **tensors):
    tensors = {"W0": W0, "B0": B0, "W1": W1, "B1": B1, **tensors}
    graph = helper.make_graph(
        nodes,
        "toy",
        [helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 3])],
        [helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 1])],
        [numpy_helper.from_array(array, name) for name, array in tensors.items()],
    )
    onnx.save(helper.make_model(graph), path)
    return path


def test_reads_the_layers(tmp_path):
    (w0, b0), (w1, b1) = read_mlp(write(tmp_path / "toy.onnx"), 3, 1)
    for found, expected in ((w0, W0), (b0, B0), (w1, W1), (b1, B1)):
        np.testing.assert_array_equal(found, expected)
        assert found.dtype == np.float32
        assert found.flags.c_contiguous
        assert not found.flags.writeable


@pytest.mark.parametrize(
    ("nodes", "complaint"),
    [
        ((CHAIN[0], helper.make_node("Tanh", ["a"], ["b"]), CHAIN[2]), r"\(Tanh\) .* only Elu"),
        ((CHAIN[0], elu("a", "b", alpha=2.0), CHAIN[2]), r"'bend' \(Elu\) .* only Elu"),
        ((gemm("x", "a", "W0", "B0", transB=0), *CHAIN[1:]), "only Gemm with"),
        ((gemm("x", "a", "W0", "B0", alpha=0.5), *CHAIN[1:]), "only Gemm with"),
        ((*CHAIN[:2], gemm("a", "y", "W1", "B1")), "does not continue the chain"),
        ((*CHAIN[:2], gemm("b", "z", "W1", "B1")), "output 'y' is not the end"),
        ((*CHAIN[:2], gemm("b", "y", "x", "B1")), "constant weight"),
        (CHAIN[:2], "one input, one output and a chain"),
    ],
)
def test_anything_else_is_refused_by_name(tmp_path, nodes, complaint):
    with pytest.raises(SumoError, match=complaint):
        read_mlp(write(tmp_path / "toy.onnx", nodes), 3, 1)


@pytest.mark.parametrize(
    ("tensors", "complaint"),
    [
        ({"W1": np.ones((1, 4), np.float32)}, r"layer 1 has weight \(1, 4\) .* for 2 inputs"),
        ({"B0": np.ones(3, np.float32)}, r"layer 0 has .* bias \(3,\)"),
        ({"W0": np.ones((2, 3)), "B0": np.ones(2)}, "float64 weights"),
    ],
)
def test_shapes_and_types_must_chain(tmp_path, tensors, complaint):
    with pytest.raises(SumoError, match=complaint):
        read_mlp(write(tmp_path / "toy.onnx", **tensors), 3, 1)


@pytest.mark.parametrize(("sizes", "complaint"), [((4, 1), "for 4 inputs"), ((3, 2), "1 outputs")])
def test_input_and_output_sizes_are_checked(tmp_path, sizes, complaint):
    with pytest.raises(SumoError, match=complaint):
        read_mlp(write(tmp_path / "toy.onnx"), *sizes)


@pytest.mark.parametrize("content", [b"", b"\x00garbage\xff" * 20])
def test_a_file_that_is_not_onnx(tmp_path, content):
    path = tmp_path / "junk.onnx"
    path.write_bytes(content)
    with pytest.raises(SumoError, match=r"junk\.onnx"):
        read_mlp(path, 3, 1)
