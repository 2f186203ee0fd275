"""What every process that runs an episode gets."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.costs.terms import CostTerm
from sumo_dist.episode.assemble import Episode, draw_start, make_plant, rehearse
from sumo_dist.episode.command import Command
from sumo_dist.episode.ending import End
from sumo_dist.errors import TaskError, UsageError
from sumo_dist.model.index import StateIndex
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.plant.scripted import ScriptedBody


def test_a_start_is_of_the_parameters_of_the_episode(quick, move_box):
    usual, moved = quick(seed=1), quick(seed=1, param=("goal=-1,2",))
    first = make_plant(usual, move_box).truth
    assert np.array_equal(first, draw_start(move_box, 1))
    index = StateIndex(make_plant(usual, move_box).model)
    x, y = first[index.pose("box")][:2]
    there = quick(seed=1, param=(f"goal={float(x)!r},{float(y)!r}",))
    again = make_plant(there, move_box).truth
    assert np.array_equal(again, draw_start(move_box, 1, there.cost(move_box).parameters))
    assert np.linalg.norm(again[index.pose("box")][:2] - [x, y]) > 0.5
    assert np.array_equal(make_plant(moved, move_box).truth, first)  # far from both


def test_everything_sent_passes_the_guard_and_is_recorded(quick, first_state):
    body = ScriptedBody([first_state])
    episode = Episode.assemble(quick(), body)
    wild = np.full(len(episode.robot.joints), 9.0)
    episode.guard.send(wild)
    episode.guard.send(np.full_like(wild, np.nan))
    assert np.array_equal(episode.recording.targets, body.sent)
    assert (np.abs(body.sent[0]) < 9.0).any()
    assert np.array_equal(body.sent[0], body.sent[1])


def test_a_question_is_of_the_numbers_of_now(quick, first_state):
    episode = Episode.assemble(quick(weight=("goal=7",)), ScriptedBody([first_state]))
    memory = episode.controller.initial_memory()
    before = episode.request(0, 0, first_state, memory, None)
    episode.controls.apply(Command(0, "ann", "weight", "goal", "8"), 0)
    after = episode.request(1, 2, first_state, memory, None)
    assert (before.cost.weights[0], after.cost.weights[0]) == (7.0, 8.0)
    assert (after.number, after.tick, after.previous) == (1, 2, None)


@pytest.mark.parametrize("knows", [True, False])
def test_the_truth_is_judged_where_it_is_known(quick, first_state, knows):
    index = StateIndex(make_plant(quick(), Episode.assemble(quick()).task).model)
    solved = first_state.copy()
    solved[index.pose("body")][:2] = 3.0, 3.0
    solved[index.pose("box")][:3] = 0.0, 0.0, 0.254
    episode = Episode.assemble(quick(), ScriptedBody([first_state], knows_truth=knows))
    verdict = episode.verdict(0, solved)
    assert (verdict is None) if knows else (verdict.kind is End.SUCCESS)
    episode.note_tick(solved, np.zeros(3, np.float32))
    episode.note_tick(None, np.zeros(3, np.float32))
    assert np.array_equal(episode.recording.states[0], first_state if knows else solved)
    assert np.array_equal(episode.recording.estimates[0], solved)
    assert len(episode.recording.states) == (2 if knows else 1)  # nobody knows: nothing to keep


def test_success_is_at_the_goal_that_was_commanded(quick, first_state):
    episode = Episode.assemble(quick(), ScriptedBody([first_state], knows_truth=False))
    index = StateIndex(episode.problem.model)
    there = first_state.copy()
    there[index.pose("box")][:3] = 1.5, -1.0, 0.254
    there[index.pose("body")][:2] = 4.0, 4.0
    assert episode.verdict(0, there) is None
    episode.controls.apply(Command(0, "ann", "parameter", "goal", "1.5,-1"), 0)
    assert episode.verdict(1, there).kind is End.SUCCESS


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"task": "spot/none"}, "unknown task 'spot/none'"),
        ({"weight": ("gaol=1",)}, "unknown cost term 'gaol'"),
        ({"param": ("goal=1",)}, "needs 2 finite numbers"),
    ],
)
def test_what_does_not_fit_is_refused(quick, change, message):
    with pytest.raises(UsageError, match=message):
        Episode.assemble(replace(quick(), **change))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"reset": lambda rng, start: start.stance}, r"reset: .* returned shape \(26,\)"),
        ({"reset": lambda rng, start: np.full(64, np.nan)}, "reset: .* not finite"),
        ({"success": lambda r: r.box.pos}, "success: .* unknown frame 'box'; valid: "),
        ({"failure": {"late": lambda r: 1 / 0}}, "failure 'late': .* ZeroDivisionError"),
        ({"cost": (CostTerm("far", lambda r: r.p.far, 1.0),)}, "'far': .* unknown parameter 'far'"),
    ],
)
def test_a_rehearsal_finds_what_the_episode_would_trip_over(quick, move_box, changes, reason):
    config = quick()
    problem = Problem.build(move_box, planning_options(config.planner))
    rehearse(config, problem)
    with pytest.raises(TaskError, match=reason) as caught:
        rehearse(config, replace(problem, task=replace(move_box, **changes)))
    assert "test_assemble.py, line " in str(caught.value)


def test_a_cost_is_rehearsed_on_as_many_steps_as_it_will_see(quick, move_box):
    def steps(r):
        return np.abs(r.object.pos[:, [1], 0] - r.object.pos[..., 0])

    config = quick()
    task = replace(move_box, cost=(CostTerm("steps", steps, 1.0),))
    rehearse(config, Problem.build(task, planning_options(config.planner)))
