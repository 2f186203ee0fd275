import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from sumo_dist.costs.terms import CostTerm, evaluate, norm
from sumo_dist.costs.view import Frame, View
from sumo_dist.errors import UsageError

VALUES = np.array([[1.0, 2.0, 6.0], [0.0, 0.0, 0.0]])  # 2 rollouts of 3 steps


def view_of(pos):
    """See one frame, `object`, at positions (B, T, 3)."""
    rot = np.broadcast_to(np.eye(3), (*pos.shape, 3))
    return View({"object": Frame("object", pos, rot)}, np.zeros((*pos.shape[:2], 9)))


@pytest.fixture
def view():
    return view_of(np.zeros((2, 3, 3)))


def constant(values):
    return lambda r: values


@pytest.mark.parametrize(
    ("reduction", "expected"), [("mean", [3.0, 0.0]), ("squared_mean", [9.0, 0.0])]
)
def test_steps_are_reduced_as_the_term_says(view, reduction, expected):
    term = CostTerm("t", constant(VALUES), 1.0, reduction)
    assert term.evaluate(view).tolist() == expected


@pytest.mark.parametrize("steps", [[True, False, False], [True, True, True]])
def test_an_indicator_counts_once_however_long_it_holds(view, steps):
    fall = CostTerm("fall", constant(np.array([steps, [False] * 3])), 2500.0, "any")
    assert fall.evaluate(view).tolist() == [1.0, 0.0]


def test_a_share_is_of_the_steps_at_which_it_holds(view):
    tipped = CostTerm("t", constant(np.array([[True, False, True], [False] * 3])), 50.0, "share")
    assert tipped.evaluate(view).tolist() == pytest.approx([2 / 3, 0.0])


@pytest.mark.parametrize("reduction", ["mean", "squared_mean", "share"])
def test_the_mean_of_a_course_is_what_the_term_costs(view, reduction):
    term = CostTerm("t", constant(VALUES - 2.0), 7.0, reduction)
    assert term.course(view).mean(axis=1) == pytest.approx(term.evaluate(view))
    assert term.course(view).shape == (2, 3)


def test_the_course_of_what_counts_once_says_when_it_holds(view):
    fall = CostTerm("fall", constant(np.array([[0, 2, 0], [0, 0, 0]])), 2500.0, "any")
    assert fall.course(view).tolist() == [[0.0, 1.0, 0.0], [0.0, 0.0, 0.0]]
    assert fall.course(view).max(axis=1).tolist() == fall.evaluate(view).tolist()


@pytest.mark.parametrize("weight", [-2.0, 0.0, 1e9])
def test_a_residual_has_no_weight(view, weight):
    assert CostTerm("t", constant(VALUES), weight).evaluate(view).tolist() == [3.0, 0.0]


def test_a_table_has_a_column_per_term(view):
    terms = (CostTerm("a", constant(VALUES), 1.0), CostTerm("b", constant(VALUES + 1), 10.0))
    assert evaluate(terms, view).tolist() == [[3.0, 4.0], [0.0, 1.0]]


@pytest.mark.parametrize("shape", [(2,), (2, 3, 3), (3, 2), (2, 1), ()])
def test_a_wrong_shape_is_named_with_its_term(view, shape):
    term = CostTerm("to_goal", constant(np.zeros(shape)), 1.0)
    with pytest.raises(UsageError) as raised:
        term.evaluate(view)
    assert str(raised.value).startswith("cost term 'to_goal': test_terms.py, line ")
    assert "returned shape" in str(raised.value)
    assert str(shape) in str(raised.value)
    assert "must be (rollouts, steps) = (2, 3)" in str(raised.value)


def test_an_unknown_reduction_names_the_valid_ones():
    with pytest.raises(
        UsageError, match="unknown reduction 'sum'; valid: any, mean, share, squared_mean"
    ):
        CostTerm("t", constant(VALUES), 1.0, "sum")


def test_a_wrong_frame_name_says_which_there_are(view):
    term = CostTerm("t", lambda r: norm(r.objekt.pos), 1.0)
    with pytest.raises(UsageError, match="unknown frame 'objekt'; valid: object"):
        term.evaluate(view)


def test_nan_stays_nan_and_is_nobodys_good_cost():
    view = view_of(np.full((1, 3, 3), np.nan))
    assert np.isnan(CostTerm("t", lambda r: norm(r.object.pos), 1.0).evaluate(view)).all()


@given(arrays(float, (4, 3), elements=st.floats(-1e6, 1e6)))
def test_norm_is_the_euclidean_norm(vectors):
    assert norm(vectors) == pytest.approx(np.linalg.norm(vectors, axis=-1))


@given(st.integers(1, 40), st.integers(1, 200), st.integers(0, 2**32 - 1))
def test_a_row_has_the_same_bits_in_any_batch(rows, steps, seed):
    values = np.random.default_rng(seed).normal(size=(rows, steps))

    class Rows:
        def __init__(self, chosen):
            self.actions, self.chosen = np.zeros((*chosen.shape, 1)), chosen

    for reduction in ("mean", "squared_mean", "any", "share"):
        term = CostTerm("t", lambda r: r.chosen, 3.7, reduction)
        alone = np.concatenate([term.evaluate(Rows(values[i : i + 1])) for i in range(rows)])
        assert np.array_equal(term.evaluate(Rows(values)), alone)
        # a view whose rows are not contiguous, as when a term slices one
        assert np.array_equal(term.evaluate(Rows(np.asfortranarray(values))), alone)
