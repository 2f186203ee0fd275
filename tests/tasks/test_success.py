"""A success test made of measures says what each of them says."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.costs.parameters import Parameters
from sumo_dist.costs.view import View
from sumo_dist.errors import UsageError
from sumo_dist.planner.fingerprint import fingerprint
from sumo_dist.tasks import load_task, task_names
from sumo_dist.tasks.success import AllBelow, Measure

VIEW = View({}, np.zeros((2, 3, 1)), Parameters({"near": 0.5, "slow": 0.1}))


def of(values, limit="near"):
    return Measure("x", lambda _: np.array(values), limit)


def test_it_holds_where_all_measures_are_below_their_limits():
    far = of([[0.6, 0.4, 0.4], [0.5, 0.1, 0.0]])
    fast = of([[0.0, 0.2, 0.05], [0.0, 0.0, 0.1]], "slow")
    assert AllBelow(far, fast)(VIEW).tolist() == [[False, False, True], [False, True, False]]


def test_a_limit_that_the_task_lacks_names_those_it_has():
    with pytest.raises(UsageError, match="unknown parameter 'far'; valid: near, slow"):
        AllBelow(of([[0.0]], "far"))(VIEW)


def test_another_measure_is_another_task():
    one, other = of([[1.0]]), of([[1.0]], "slow")
    assert fingerprint(AllBelow(one)) != fingerprint(AllBelow(other))
    assert fingerprint(AllBelow(one)) != fingerprint(AllBelow(replace(one, name="y")))


@pytest.mark.parametrize("name", task_names())
def test_every_task_of_ours_states_its_success_as_measures(name):
    task = load_task(name)
    assert isinstance(task.success, AllBelow)
    assert {m.limit for m in task.success.measures} <= set(task.table.parameters)
