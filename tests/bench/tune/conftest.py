import pytest

WALK = '''
"""Spot walks ahead if its cost says so, and the sooner the less it is told to stand."""

from dataclasses import replace

import numpy as np

from sumo_dist import CostTerm, Parameter, load_task

BOX = (np.array([3.0, 3.0, 0.254]), np.array([1.0, 0.0, 0.0, 0.0]))


def task():
    box = load_task("spot/move_box")
    return replace(
        box,
        name="spot/walk",
        cost=(
            CostTerm("ahead", lambda r: -r.base.pos[..., 0], 1.0),
            CostTerm("stand", lambda r: abs(r.base.pos[..., 0]) * r.p.slope, 1.0),
        ),
        parameters=(Parameter("far", 0.05, "m"), Parameter("slope", 1.0, "", (0.0, 9.0))),
        goal=None,
        success=lambda r: r.base.pos[..., 0] > r.p.far,
        failure={},
        reset=lambda _, start: start.place(np.zeros(2), 0.0, {"box": BOX}),
        time_limit=0.8,
        planner={"rollouts": 6, "horizon": 0.4},
    )
'''


@pytest.fixture(scope="session")
def walk(tmp_path_factory):
    """Path of a task that is soon over, and solved where `ahead` weighs more than `stand`."""
    path = tmp_path_factory.mktemp("task") / "walk.py"
    path.write_text(WALK)
    return path
