from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model.scene import PLANNING, Scene, SceneObject, compile_model
from sumo_dist.model.variation import Spread, draw, varied
from sumo_dist.robots.g1 import G1
from sumo_dist.robots.spot import SPOT

SPREAD = Spread(mass=0.3, inertia=0.2, friction=0.5, stiffness=0.1, damping=0.4)


@pytest.fixture(scope="module", params=[SPOT, G1], ids=lambda robot: robot.name)
def model(request):
    scene = Scene(request.param, (SceneObject("box", "objects/box.xml"),))
    return compile_model(scene, PLANNING)


def saved(model):
    """Every number of a model."""
    numbers = np.empty(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, numbers)
    return numbers


def test_factors_lie_within_the_spread_and_an_object_is_one_piece(model):
    variation = draw(model, SPREAD, np.random.default_rng(0))
    for name, width in vars(SPREAD).items():
        assert np.abs(getattr(variation, name) - 1.0).max() <= width
        assert len(np.unique(getattr(variation, name))) > 2
    box = model.body("box").id
    pieces = model.body_rootid == box
    assert len(np.unique(variation.mass[pieces])) == 1


def test_factors_of_one_change_no_number(model):
    nothing = draw(model, Spread(), np.random.default_rng(0))
    np.testing.assert_array_equal(saved(varied(model, nothing)), saved(model))


def test_numbers_are_scaled_and_what_follows_from_them_is_computed(model):
    before = saved(model)
    variation = draw(model, SPREAD, np.random.default_rng(1))
    other = varied(model, variation)
    np.testing.assert_array_equal(saved(model), before)
    np.testing.assert_array_equal(other.body_mass, model.body_mass * variation.mass)
    np.testing.assert_array_equal(other.actuator_gainprm[:, 0], -other.actuator_biasprm[:, 1])
    np.testing.assert_allclose(other.body_subtreemass[0], other.body_mass.sum())
    assert not np.array_equal(other.dof_invweight0, model.dof_invweight0)


def test_the_layout_stays(model):
    other = varied(model, draw(model, SPREAD, np.random.default_rng(2)))
    assert (other.nq, other.nv, other.nu) == (model.nq, model.nv, model.nu)
    for name in ("body_simple", "body_sameframe", "dof_simplenum", "M_rownnz", "geom_contype"):
        np.testing.assert_array_equal(getattr(other, name), getattr(model, name))


@pytest.mark.parametrize("name", ["mass", "inertia", "friction", "stiffness", "damping"])
def test_refuses_what_does_not_fit(model, name):
    variation = draw(model, SPREAD, np.random.default_rng(0))
    factors = getattr(variation, name)
    with pytest.raises(UsageError, match=rf"{name} has shape \({len(factors) - 1},\)"):
        varied(model, replace(variation, **{name: factors[1:]}))
    for bad in (0.0, -1.0, np.nan, np.inf):
        spoilt = factors.copy()
        spoilt[1] = bad
        with pytest.raises(UsageError, match=f"{name} has a factor that is not positive"):
            varied(model, replace(variation, **{name: spoilt}))
