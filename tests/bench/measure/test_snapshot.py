import numpy as np
import pytest

from sumo_dist.bench.measure.snapshot import Snapshot
from sumo_dist.errors import UsageError
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import PLANNING, compile_model
from sumo_dist.tasks import load_task


@pytest.mark.parametrize("robot", ["spot", "g1"])
def test_the_packaged_snapshots_walk_and_push(robot):
    snapshot = Snapshot.load(robot)
    task = load_task(snapshot.task)
    assert task.scene.robot.name == robot
    index = StateIndex(compile_model(task.scene, PLANNING))
    for body, least in ((task.scene.robot.base, 0.2), ("box", 0.1)):
        assert np.linalg.norm(snapshot.state[index.velocity(body)][:3]) > least


def test_commands_are_the_plans_and_samples_around_it():
    commands = Snapshot.load().commands(8)
    assert commands.shape == (8, 75, 25)
    assert (commands == Snapshot.load().commands(8)).all()
    assert len(np.unique(commands[:, -1, 0])) > 4  # [m/s] of the last step


def test_an_unknown_robot_is_named():
    with pytest.raises(UsageError, match="unknown robot 'dog'; valid: g1, spot"):
        Snapshot.load("dog")
