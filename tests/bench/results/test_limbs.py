"""What recorded trials did with their limbs is counted as it was."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.bench.results.limbs import Use, rows, use
from sumo_dist.bench.results.outcomes import RECORDINGS
from sumo_dist.cli import main
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.model.index import StateIndex
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.record.world import World

QUICK = PlannerConfig(rollouts=2, horizon=0.4)
TICKS = 10


@pytest.fixture(scope="module")
def drag():
    """A recorded start of a task that has the gripper and the torso."""
    config = EpisodeConfig("spot/demo_barrier_drag", 1, QUICK, time_limit=TICKS * 0.02)
    return run_single(config, threads=1)[0]


def test_a_way_is_dragged_while_the_jaw_is_around_something(drag):
    """For half of the time, in which the object does three quarters of its way."""
    world = World.of(drag)
    index, names = StateIndex(world.model), world.task.actions.names
    jaw, speed = index.columns["arm_f1x"]
    states, actions, targets = (
        np.array(a) for a in (drag.states, drag.actions[:TICKS], drag.targets[:TICKS])
    )
    states = states[:TICKS].copy()
    gripped = np.arange(TICKS) >= TICKS // 2
    states[:, jaw], states[:, speed] = np.where(gripped, -0.4, -1.54), 0.0
    targets[:, -1] = np.where(gripped, 0.0, -1.54)
    steps = np.where(gripped, 0.3, 0.125)
    steps[0] = 0.0
    states[:, index.pose("barrier")][:, :3] = 0.0
    states[:, index.pose("barrier").start] = np.cumsum(steps)
    actions[:, names.index("torso_height")] = np.linspace(0.4, 0.6, TICKS)
    name, found = use(replace(drag, states=states, actions=actions, targets=targets))
    assert name == "spot/demo_barrier_drag"
    assert found.grip == pytest.approx(0.5)
    assert found.dragged == pytest.approx(0.75)
    assert found.height == pytest.approx((0.4, 0.6))
    assert found.left is found.right is None


def test_rows_are_means_over_trials_and_extremes_of_the_torso():
    (row,) = rows(
        [
            ("a", Use(left=0.1, right=0.3, height=(0.4, 0.5))),
            ("a", Use(left=0.3, right=0.1, height=(0.3, 0.6))),
        ]
    )
    assert row == ["a", "2", "-", "-", "20%", "20%", "0.30 to 0.60", "-"]


def test_a_folder_of_trials_is_laid_out_without_those_that_only_stood(drag, tmp_path, capsys):
    for name in ("one", "one-standing"):
        (tmp_path / RECORDINGS / name).mkdir(parents=True)
        drag.save(tmp_path / RECORDINGS / name / "run.npz")
    assert main(["bench", "limbs", str(tmp_path)]) == 0
    assert "| spot/demo_barrier_drag | 1 " in capsys.readouterr().out


def test_a_folder_without_recordings_is_told(tmp_path, capsys):
    assert main(["bench", "limbs", str(tmp_path)]) == 2
    assert "holds no recordings: bench suite --recordings all" in capsys.readouterr().err
