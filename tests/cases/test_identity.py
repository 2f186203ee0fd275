import pytest

from sumo_dist.check.identity import parts
from sumo_dist.tasks import load_task

KIND = "identity of a task"
DRAWN = """
OFFSET = {}

def far(r):
    return norm(r.object.pos) + OFFSET
"""
FAR = "replace(move(DRUM), cost=(*move(DRUM).cost, CostTerm('far', far, 1.0)))"


@pytest.mark.parametrize(
    ("brought", "code", "returns", "says"),
    [
        ("a number drawn by numpy", DRAWN.format("np.random.rand()"), FAR, "'far' .mine.py, line"),
        (
            *("a goal that is drawn", ""),
            *("replace(move(DRUM), reset=partial(move(DRUM).reset, random.random()))", "reset"),
        ),
    ],
)
def test_what_differs_from_process_to_process_is_told(
    ask, write_task, brought, code, returns, says
):
    path = write_task(returns, f"from functools import partial\n{code}")
    says = f"FAIL +identity .*{says}.* differs from process to process"
    ask(KIND, brought, "task", "check", path, "--seeds", 2, code=1, says=says)


def test_a_helper_beside_the_task_is_a_part_of_it(ask, write_task, tmp_path, monkeypatch):
    """The other half of this kind: two hosts with two versions of a helper have two tasks."""
    monkeypatch.setattr("sumo_dist.check.speed.COST_LIMIT", 10.0)  # the machine is shared
    path = write_task(FAR, "import helper\n\ndef far(r):\n    return helper.far(r)")
    text = "import numpy as np\n\ndef far(r):\n    return {} * np.abs(r.object.pos[..., 0])\n"
    (tmp_path / "helper.py").write_text(text.format(2.0))
    command = "task", "check", path, "--seeds", 2
    says = "ok +identity .* in two fresh processes"
    printed = ask(KIND, "a module beside the task", *command, code=0, says=says)
    before = parts(load_task(str(path)))
    assert before["the task"] in printed
    (tmp_path / "helper.py").write_text(text.format(3.0))
    after = parts(load_task(str(path)))
    changed = {part for part in before if before[part] != after[part]}
    assert changed == {"the task", "cost term 'far' (mine.py, line 15)"}
