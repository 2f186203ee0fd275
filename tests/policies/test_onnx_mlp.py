import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper

from sumo_dist.errors import SumoError
from sumo_dist.policies.network import evaluate
from sumo_dist.policies.onnx_mlp import read_metadata, read_mlp

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
    first, last = read_mlp(write(tmp_path / "toy.onnx"), 3, 1)
    assert (first.activation, last.activation) == ("elu", "linear")
    pairs = ((first.weight, W0), (first.bias, B0), (last.weight, W1), (last.bias, B1))
    for found, expected in pairs:
        np.testing.assert_array_equal(found, expected)
        assert found.dtype == np.float32
        assert found.flags.c_contiguous
        assert not found.flags.writeable


@pytest.mark.parametrize(
    ("nodes", "complaint"),
    [
        ((CHAIN[0], helper.make_node("Relu", ["a"], ["b"]), CHAIN[2]), r"\(Relu\) is not supp"),
        ((CHAIN[0], elu("a", "b", alpha=2.0), CHAIN[2]), r"'bend' \(Elu\) .* only Elu"),
        ((gemm("x", "a", "W0", "B0", transB=0), *CHAIN[1:]), "only Gemm with"),
        ((gemm("x", "a", "W0", "B0", alpha=0.5), *CHAIN[1:]), "only Gemm with"),
        ((*CHAIN[:2], gemm("a", "y", "W1", "B1")), "does not continue the chain"),
        ((*CHAIN[:2], gemm("b", "z", "W1", "B1")), "output 'y' is not the end"),
        ((*CHAIN[:2], gemm("b", "y", "x", "B1")), "constant weight"),
        (CHAIN[:2], "output 'y' is not the end"),
        ((*CHAIN[:2], helper.make_node("Sigmoid", ["b"], ["y"])), r"\(Sigmoid\) is not supported"),
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


def node(op, inputs, output, **attributes):
    return helper.make_node(op, inputs, [output], **attributes)


def normalised(source, target, stem, axes=(-1,)):
    """Layer normalisation as exporters spell it out."""
    return (
        node("ReduceMean", [source], f"{stem}0", axes=axes),
        node("Sub", [source, f"{stem}0"], f"{stem}1"),
        node("Pow", [f"{stem}1", "two"], f"{stem}2"),
        node("ReduceMean", [f"{stem}2"], f"{stem}3", axes=[-1]),
        node("Add", [f"{stem}3", "epsilon"], f"{stem}4"),
        node("Sqrt", [f"{stem}4"], f"{stem}5"),
        node("Div", [f"{stem}1", f"{stem}5"], f"{stem}6"),
        node("Mul", [f"{stem}6", "scale"], f"{stem}7"),
        node("Add", [f"{stem}7", "shift"], target),
    )


def constant(name, value):
    return node("Constant", [], name, value=numpy_helper.from_array(np.array(value)))


PARTS = {
    "mean": np.array([[0.5, -1.0, 2.0]], np.float32),
    "std": np.array([[2.0, 0.5, 4.0]], np.float32),
    "two": np.float32(2.0),
    "epsilon": np.float32(1e-5),
    "scale": np.array([0.5, 2.0], np.float32),
    "shift": np.array([0.1, -0.2], np.float32),
    "factor": np.array([3.0], np.float32),
    "zero": np.zeros(1, np.float32),
}
RICH = (
    node("Sub", ["x", "mean"], "n0"),
    node("Div", ["n0", "std"], "n1"),
    constant("starts", [0]),
    constant("ends", [3]),
    constant("axes", [1]),
    constant("steps", [1]),
    node("Slice", ["n1", "starts", "ends", "axes", "steps"], "n2"),
    node("Concat", ["n2"], "n3", axis=-1),
    gemm("n3", "a", "W0", "B0"),
    *normalised("a", "b", "norm"),
    node("Sigmoid", ["b"], "c"),
    node("Mul", ["b", "c"], "d"),
    gemm("d", "e", "W1", "B1"),
    node("Tanh", ["e"], "f"),
    node("Mul", ["f", "factor"], "g"),
    node("Add", ["g", "zero"], "y"),
)


def test_reads_normaliser_norms_silu_tanh_and_gain(tmp_path):
    first, last = read_mlp(write(tmp_path / "rich.onnx", RICH, **PARTS), 3, 1)
    assert (first.activation, last.activation) == ("silu", "tanh")
    rows = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
    hidden = (rows - PARTS["mean"]) / PARTS["std"] @ W0.T.astype(float) + B0
    hidden = hidden - hidden.mean(axis=1, keepdims=True)
    hidden /= np.sqrt((hidden**2).mean(axis=1, keepdims=True) + 1e-5)
    hidden = hidden * PARTS["scale"] + PARTS["shift"]
    hidden = hidden / (1.0 + np.exp(-hidden))
    expected = 3.0 * np.tanh(hidden @ W1.T + B1)
    np.testing.assert_allclose(evaluate((first, last), rows), expected, rtol=1e-5)


@pytest.mark.parametrize(
    ("tensors", "complaint"),
    [
        ({"epsilon": np.float32(1e-3)}, "begins no layer normalisation with epsilon 1e-05"),
        ({"two": np.float32(3.0)}, "begins no layer normalisation"),
        ({"zero": np.ones(1, np.float32)}, "shifts the outputs"),
        ({"scale": np.ones(3, np.float32)}, "norm or gain"),
    ],
)
def test_other_constants_are_refused(tmp_path, tensors, complaint):
    with pytest.raises(SumoError, match=complaint):
        read_mlp(write(tmp_path / "rich.onnx", RICH, **{**PARTS, **tensors}), 3, 1)


def test_a_slice_that_drops_inputs_is_refused(tmp_path):
    nodes = [constant("ends", [2]) if n.output[0] == "ends" else n for n in RICH]
    with pytest.raises(SumoError, match="drops inputs"):
        read_mlp(write(tmp_path / "rich.onnx", nodes, **PARTS), 3, 1)


def test_metadata(tmp_path):
    path = write(tmp_path / "toy.onnx")
    model = onnx.load(path)
    helper.set_model_props(model, {"kp": "[1.0]"})
    onnx.save(model, path)
    assert read_metadata(path) == {"kp": "[1.0]"}
