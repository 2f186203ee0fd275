import numpy as np
import pytest

from sumo_dist.bench.measure.channels import Errors, errors_of
from sumo_dist.bench.measure.estimator import PROFILES, row, text
from sumo_dist.bench.measure.walks import Newest, walk
from sumo_dist.estimate import LowPassConfig
from sumo_dist.math.rotations import from_rotation_vector, multiply
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANT, compile_model
from sumo_dist.tasks import load_task


@pytest.fixture(scope="module")
def index():
    return StateIndex(compile_model(load_task("spot/move_box").scene, PLANT))


def test_errors_are_root_mean_squares_of_vectors(index):
    states = np.zeros((4, index.nq + index.nv))
    for body in ("body", "box"):
        states[:, index.pose(body).start + 3] = 1.0
    seen = states.copy()
    seen[:, index.pose("body")][:, :3] += (0.003, 0.0, 0.004)
    seen[::2, index.velocity("box").start] += 2.0
    turn = from_rotation_vector(np.array([0.0, 0.01, 0.0]))
    seen[:, index.pose("box").start + 3 : index.pose("box").stop] = multiply(
        turn, seen[:, index.pose("box")][:, 3:]
    )
    errors = errors_of(index, states, seen)
    assert errors == pytest.approx(Errors(5.0, 0, 0, 0, 0, 0, 0, 10.0, np.sqrt(2.0), 0), abs=1e-9)


@pytest.mark.slow
def test_noise_shows_where_it_is_and_is_laid_out():
    rows = []
    for name in ("no noise", "mocap outliers"):
        done = walk("turn", PROFILES[name], 0, 1.2, LowPassConfig())
        rows.append(row(name, "turn", [done], [done.estimates]))
    quiet, noisy = rows
    assert quiet["walked"] == noisy["walked"] == 1
    assert quiet["outliers"] == 0 < noisy["outliers"]
    assert 0 < quiet["base_mm"] < 1.0
    about = {"sumo_dist": "0", "mujoco": "0", "python": "0", "machine": "m", "load": "1"}
    table = text({**about, "filters": {}, "seeds": 1, "seconds": 1.2, "rows": rows})
    assert "| no noise       | turn   | 1/1 " in table


@pytest.mark.slow
def test_delayed_frames_are_moved_on_and_better_than_held():
    done = walk("turn", PROFILES["mocap delay"], 0, 2.0, LowPassConfig())
    moved, held = done.errors(done.estimates), done.errors(done.replay(Newest(done.model)))
    assert moved is not None and held is not None
    assert 5 * moved.base_mm < held.base_mm
    assert moved.base_mrad < held.base_mrad
