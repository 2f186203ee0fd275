"""Spot sets objects upright by its joints alone: what end-to-end policies are tried on (paper)."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from sumo_dist.tasks.spot.analysis import ANALYSIS
from sumo_dist.tasks.spot.end_to_end import InStep, joints_move
from sumo_dist.tasks.task import Task


def joints_upright(name: str) -> Task:
    """Spot sets an object upright by the targets of its joints, without a low-level policy.

    The metronome turns as in `joints_move`, so that a policy trained there sees the same here. No
    term is of the gait: the paper plans end to end for Move only.

    Args:
        name: of the object.
    """
    task, moved = ANALYSIS[f"spot/upright_{name}"](), joints_move(name)
    return replace(
        task,
        name=f"spot/joints_upright_{name}",
        scene=moved.scene,
        actions=moved.actions,
        reset=InStep(task.reset),
        controller=moved.controller,
        planner=moved.planner,
        description=f"Spot sets the {name} upright by its joints alone, without a policy",
    )


JOINTS_UPRIGHT: dict[str, Callable[[], Task]] = {
    f"spot/joints_upright_{name}": partial(joints_upright, name)
    for name in ("box", "chair", "cone", "tire", "rack")
}
