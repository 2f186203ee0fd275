import numpy as np
import pytest

from sumo_dist.bench.measure.estimator import PROFILES, filters, row, text
from sumo_dist.bench.measure.walks import Errors, errors_of, walk
from sumo_dist.errors import UsageError
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


def test_settings_of_the_filters_are_checked():
    assert filters(["position_hz=7"]).position_hz == 7.0
    with pytest.raises(UsageError, match=r"unknown filter setting 'foo'; valid: .*blind_ms"):
        filters(["foo=1"])
    with pytest.raises(UsageError, match="position_hz needs a number, got 'fast'"):
        filters(["position_hz=fast"])


@pytest.mark.slow
def test_noise_shows_where_it_is_and_is_laid_out():
    rows = []
    for name in ("no noise", "hard"):
        done = walk("turn", PROFILES[name], 0, 1.2, LowPassConfig())
        rows.append({"profile": name, "motion": "turn", **row([done])})
    quiet, noisy = rows
    assert quiet["walked"] == noisy["walked"] == 1
    assert quiet["outliers"] == 0 < noisy["outliers"]
    assert 0 < quiet["base_mm"] < 1.0
    _, table = text({"filters": {}, "seeds": 1, "seconds": 1.2, "rows": rows})
    assert "| no noise | turn   | 1/1 " in table


@pytest.mark.slow
def test_a_walk_that_ends_too_early_has_no_errors():
    done = walk("turn", PROFILES["no noise"], 0, 0.1, LowPassConfig())
    assert done.errors() is None
    assert np.isnan(row([done])["base_mm"])
