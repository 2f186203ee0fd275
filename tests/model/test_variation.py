from dataclasses import replace

import mujoco
import numpy as np
import pytest

from sumo_dist.errors import UsageError
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANNING, Scene, SceneObject, compile_model
from sumo_dist.model.variation import Spread, Variation, draw, varied
from sumo_dist.robots.g1 import G1
from sumo_dist.robots.spot import SPOT

SPREAD = Spread(mass=0.3, inertia=0.2, friction=0.5, stiffness=0.1, damping=0.4)
SIZES = Spread(size=0.3)


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
    variation = draw(model, replace(SPREAD, size=0.3), np.random.default_rng(0))
    for name, width in vars(replace(SPREAD, size=0.3)).items():
        assert np.abs(getattr(variation, name) - 1.0).max() <= width
        assert len(np.unique(getattr(variation, name))) > 1
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


@pytest.mark.parametrize("name", ["mass", "inertia", "friction", "stiffness", "damping", "size"])
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


def test_only_objects_have_another_size_and_without_a_spread_nothing_is_drawn(model):
    variation = draw(model, SIZES, np.random.default_rng(0))
    box = model.body("box").id
    of_box = model.body_rootid == box
    assert (variation.size[~of_box] == 1.0).all()
    assert 0.7 <= variation.size[box] <= 1.3
    assert variation.size[box] != 1.0
    one, other = (np.random.default_rng(0) for _ in range(2))
    np.testing.assert_array_equal(draw(model, SPREAD, one).size, 1.0)
    draw(model, replace(SPREAD, size=0.1), other)
    assert one.random() != other.random()


@pytest.fixture(scope="module")
def bigger(model):
    ones = draw(model, Spread(), np.random.default_rng(0))
    return varied(
        model, replace(ones, size=np.where(model.body_rootid == model.body("box").id, 1.5, 1.0))
    )


def test_all_lengths_of_an_object_grow_and_its_mass_stays(model, bigger):
    box, geom = model.body("box").id, model.geom("box/collision").id
    np.testing.assert_allclose(bigger.geom_size[geom], 1.5 * model.geom_size[geom])
    np.testing.assert_allclose(bigger.geom_rbound[geom], 1.5 * model.geom_rbound[geom])
    np.testing.assert_allclose(bigger.body_inertia[box], 2.25 * model.body_inertia[box])
    np.testing.assert_array_equal(bigger.body_mass, model.body_mass)
    others = model.geom_bodyid != box
    np.testing.assert_array_equal(bigger.geom_size[others], model.geom_size[others])


def test_a_bigger_box_comes_to_rest_higher(model, bigger):
    for each, height in ((model, 0.254), (bigger, 1.5 * 0.254)):
        data = mujoco.MjData(each)
        place = data.qpos[StateIndex(each).pose("box")]
        place[:3] = 3.0, 0.0, height + 0.02
        mujoco.mj_step(each, data, round(1.0 / each.opt.timestep))
        assert place[2] == pytest.approx(height, abs=0.005)


def test_what_has_a_mesh_keeps_its_size():
    spec = mujoco.MjSpec.from_string(
        """<mujoco><asset><mesh name="m" vertex="0 0 0 1 0 0 0 1 0 0 0 1"/></asset>
        <worldbody><body name="stone"><freejoint/><geom name="g" type="mesh" mesh="m"/></body>
        </worldbody></mujoco>"""
    )
    model = spec.compile()
    ones, none = np.ones(model.nbody), np.ones(0)
    variation = Variation(ones, ones, np.ones(model.ngeom), none, none, np.array([1.0, 1.2]))
    with pytest.raises(UsageError, match="'stone' cannot have another size: its geom 'g' is no"):
        varied(model, variation)
