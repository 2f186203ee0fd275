"""What an operator may say, what comes of it, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.command import Command, Controls, Nobody, Repeater, stopped
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End, Ending
from sumo_dist.errors import Interrupted, SumoError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.tasks import load_task

CONFIG = EpisodeConfig(
    "spot/move_box",
    seed=5,
    planner=PlannerConfig(rollouts=6),
    estimator="lowpass",
    plant="hard",
    time_limit=7.0,
    weight=("goal=80",),
    param=("goal=1,0",),
)


@pytest.fixture
def controls(move_box):
    return Controls(CONFIG, move_box)


def command(verb, name="", value="", number=0):
    return Command(number, "ann", verb, name, value)


def test_it_begins_as_configured(controls, move_box):
    assert controls.cost.weights.tolist() == [80.0, 4.0, 20.0, 2500.0]
    assert controls.cost.parameters.tolist() == [1.0, 0.0, 0.1, 0.05]
    assert controls.planner == CONFIG.planner
    assert (controls.paused, controls.following, controls.commands) == (False, None, [])


def test_numbers_change_from_the_next_plan_on(controls):
    before = controls.cost
    for number, words in enumerate(
        (("weight", "velocity", "7.5"), ("parameter", "goal", "-1,2"), ("planner", "rollouts", "9"))
    ):
        assert controls.apply(command(*words, number=number), 12 + number) == ""
    assert controls.cost.weights.tolist() == [80.0, 4.0, 7.5, 2500.0]
    assert controls.cost.parameters.tolist() == [-1.0, 2.0, 0.1, 0.05]
    assert controls.planner.rollouts == 9
    assert before.weights.tolist() == [80.0, 4.0, 20.0, 2500.0]  # what a question has stays so
    assert controls.commands == [
        {"tick": 12, "number": 0, "sender": "ann", "verb": "weight", "name": "velocity"}
        | {"value": "7.5"},
        {"tick": 13, "number": 1, "sender": "ann", "verb": "parameter", "name": "goal"}
        | {"value": "-1,2"},
        {"tick": 14, "number": 2, "sender": "ann", "verb": "planner", "name": "rollouts"}
        | {"value": "9"},
    ]


@pytest.mark.parametrize(
    ("words", "refusal"),
    [
        (("weight", "gaol", "1"), "unknown cost term 'gaol'; valid: fall, goal, gripper"),
        (("weight", "goal", "much"), "is not of the form name=number"),
        (("weight", "goal", "nan"), "must be a finite number"),
        (("weight", "goal=1", "2"), "is not of the form name=number"),
        (("weight", "", ""), "is not of the form name=number"),
        (("parameter", "goal", "9,0"), "must be from -8 to 8 m"),
        (("parameter", "goal", "1"), "needs 2 finite numbers"),
        (("parameter", "gaol", "1"), "unknown parameter 'gaol'"),
        (("planner", "rolouts", "3"), "unknown setting 'rolouts'"),
        (("planner", "rollouts", "0"), "rollouts must be from 1"),
        (("planner", "nodes", "6"), "nodes cannot change while an episode runs"),
        (("planner", "rate", "50"), "rate cannot change while an episode runs"),
        (("step", "", ""), "pause first: a step is of a robot that is paused"),
        (("reset", "", "soon"), "seed must be a whole number from 0 to"),
        (("reset", "", "-1"), "seed must be a whole number from 0 to"),
        (("reset", "", "1.5"), "seed must be a whole number from 0 to"),
        (("reset", "", str(2**63)), "seed must be a whole number from 0 to"),
        (("task", "spot/none", ""), "unknown task 'spot/none'; valid: "),
        (("task", "", ""), "unknown task ''"),
        (("task", "nowhere.py", ""), "nowhere.py does not exist on this host"),
        (("task", "spot/move_cone", "x"), "seed must be a whole number"),
    ],
)
def test_what_makes_no_sense_is_refused_and_changes_nothing(controls, words, refusal):
    cost, planner = controls.cost, controls.planner
    assert refusal in controls.apply(command(*words), 3)
    assert controls.cost is cost
    assert controls.planner is planner
    assert (controls.paused, controls.following, controls.commands) == (False, None, [])


@pytest.mark.parametrize("value", ["0", "-1", "10001", "two", "1.5"])
def test_a_step_is_of_whole_ticks(controls, value):
    controls.apply(command("pause"), 0)
    assert "step must be a whole number from 1 to 10000" in controls.apply(
        command("step", value=value), 0
    )


def test_a_body_that_cannot_hold_its_time_is_not_paused(move_box):
    controls = Controls(CONFIG, move_box, can_hold=False)
    assert "time cannot be held; stop it instead" in controls.apply(command("pause"), 0)
    assert not controls.paused
    assert controls.apply(command("weight", "goal", "1"), 0) == ""


def test_a_reset_follows_with_the_numbers_of_now(controls):
    for words in (
        *(("weight", "velocity", "7.5"), ("parameter", "goal", "-1,2")),
        *(("planner", "rollouts", "9"), ("reset", "", "")),
    ):
        assert controls.apply(command(*words), 3) == ""
    following = controls.following
    assert following.weight == ("goal=80.0", "velocity=7.5")
    assert following.param == ("goal=-1.0,2.0",)
    assert following.planner == PlannerConfig(rollouts=9)
    kept = ("task", "seed", "clock", "estimator", "plant", "time_limit", "engine")
    assert [getattr(following, key) for key in kept] == [getattr(CONFIG, key) for key in kept]


def test_a_reset_may_bring_another_seed(controls):
    controls.apply(command("reset", value="77"), 3)
    assert controls.following.seed == 77
    assert controls.following.cost is not None
    assert controls.following.weight == ("goal=80.0",)


def test_another_task_has_its_own_numbers(controls):
    controls.apply(command("weight", "goal", "1"), 0)
    controls.apply(command("planner", "rollouts", "9"), 0)
    assert controls.apply(command("task", "spot/move_cone", "3"), 3) == ""
    following = controls.following
    assert (following.task, following.seed) == ("spot/move_cone", 3)
    assert (following.weight, following.param) == ((), ())
    assert following.planner.rollouts == 9
    assert (following.plant, following.time_limit) == ("hard", 7.0)


@pytest.mark.parametrize("words", ["reset", "task spot/move_cone="])
def test_another_episode_ends_this_one(controls, script, words):
    operator = script(t4=[[words, "weight goal=1"]])
    ending = controls.operate(operator, 4)
    assert ending == Ending(End.REPLACED, f"{words.split()[0]} by ann")
    late = f"the episode ends: replaced: {words.split()[0]} by ann"
    assert operator.answers == [(words.split()[0], 4, ""), ("weight", 4, late)]
    assert len(controls.commands) == 1


@pytest.mark.parametrize(("value", "detail"), [("a dog", "ann: a dog"), ("", "ann")])
def test_a_stop_comes_before_all_that_has_come_with_it(controls, script, value, detail):
    """Everybody gets an answer; a second stop is obeyed by the first."""
    operator = script(t4=[["reset", f"stop {value}", "weight goal=2", "stop later"]])
    assert controls.operate(operator, 4) == Ending(End.STOPPED, detail)
    late = f"the episode ends: stopped by {detail}"
    assert operator.answers == [
        *(("stop", 4, ""), ("stop", 4, ""), ("reset", 4, late), ("weight", 4, late)),
    ]
    assert [said["verb"] for said in controls.commands] == ["stop"]
    assert (controls.cost.weights[0], controls.following) == (80.0, None)


def test_a_stop_reaches_a_robot_that_is_paused(controls, script):
    operator = script(t4=[["pause"], [], ["stop"]])
    assert controls.operate(operator, 4) == stopped(command("stop"))
    assert operator.looks == [(4, False), (4, True), (4, True)]


def test_a_paused_robot_waits_and_takes_as_many_steps_as_it_is_told(controls, script):
    operator = script(t4=[["pause"], ["weight goal=3"], ["step 2"]], t6=[["step"]], t7=[["resume"]])
    passed = [controls.operate(operator, tick) for tick in range(4, 9)]
    assert passed == [None] * 5
    assert operator.looks == [
        *((4, False), (4, True), (4, True)),  # it waits at 4 until it is told to step
        (5, False),  # the second of two steps
        *((6, True), (7, True), (8, False)),
    ]
    assert not controls.paused


def test_steps_add_up_and_a_pause_forgets_those_that_are_left(controls, script):
    operator = script(t4=[["pause", "step 2", "step 3"]], t6=[["pause"], ["step"]], t7=[["resume"]])
    for tick in range(4, 8):
        controls.operate(operator, tick)
    assert operator.looks == [(4, False), (5, False), (6, False), (6, True), (7, True)]


def test_refusals_are_told_and_not_kept(controls, script):
    operator = script(t4=[["step", "weight gaol=1", "stand"]])
    assert controls.operate(operator, 4) is None
    assert [(verb, bool(refusal)) for verb, _, refusal in operator.answers] == [
        *(("step", True), ("weight", True), ("stand", False)),
    ]
    assert [said["verb"] for said in controls.commands] == ["stand"]


def test_nobody_says_nothing(controls):
    assert controls.operate(Nobody(), 0) is None
    Nobody().answer(command("pause"), 0, "")


def recorded(tick, verb, name="", value=""):
    return {"tick": tick, "number": 1, "sender": "ann", "verb": verb, "name": name, "value": value}


def test_a_repeater_gives_the_commands_of_a_tick_once():
    repeater = Repeater([recorded(3, "weight", "goal", "1"), recorded(5, "pause")])
    assert not repeater.take(2, 0.0)
    assert repeater.take(3, 0.0) == [Command(1, "ann", "weight", "goal", "1")]
    assert not repeater.take(3, 0.0)
    assert repeater.take(5, 0.0) == [Command(1, "ann", "pause")]


def test_a_repeater_ends_where_a_recorded_episode_was_interrupted():
    repeater = Repeater([recorded(3, "pause")], last_tick=3)
    assert repeater.take(3, 0.0)
    with pytest.raises(Interrupted):  # it was paused: no tick came behind
        repeater.take(3, 0.05)
    repeater = Repeater([recorded(3, "weight", "goal", "1")], last_tick=3)
    assert repeater.take(3, 0.0)
    with pytest.raises(Interrupted):
        repeater.take(4, 0.0)


def test_a_repeater_does_not_pass_over_a_refusal():
    with pytest.raises(SumoError, match="tick 4: weight, carried out before, is refused: no"):
        Repeater([]).answer(command("weight"), 4, "no")


def test_commands_of_a_recording_are_plain(controls):
    """As JSON has them: numbers and texts."""
    controls.apply(command("weight", "goal", "1"), int(np.int64(3)))
    (said,) = controls.commands
    assert {type(value) for value in said.values()} == {int, str}


def test_another_task_brings_its_own_settings_and_what_was_asked_for_stays():
    task = load_task("g1/box_push")
    planner = PlannerConfig.resolve(task.planner, settings=["rollouts=6"])
    controls = Controls(EpisodeConfig("g1/box_push", planner=planner), task)
    other = replace(task, name="g1/other", planner={"horizon": 1.0})
    assert controls._planner_of(other) == PlannerConfig(horizon=1.0, rollouts=6)
    controls.apply(command("planner", "horizon", "2.0"), 0)
    assert controls._planner_of(other) == PlannerConfig(horizon=2.0, rollouts=6)
    assert controls.apply(command("task", "g1/door_open"), 1) == ""
    assert controls.following.planner == PlannerConfig.resolve(task.planner).changed(
        {"horizon": 2.0, "rollouts": 6}
    )


def test_guidance_is_refused_where_there_is_nothing_to_guide():
    task = load_task("spot/move_box")
    controls = Controls(EpisodeConfig("spot/move_box"), task)
    assert controls.apply(command("planner", "guidance", "object"), 0) == ""
    assert controls.planner.guidance == "object"
    refusal = controls.apply(command("task", "spot/upright_box"), 0)
    assert refusal.startswith("guidance=object is not for task 'spot/upright_box': it has no goal")
    upright = Controls(EpisodeConfig("spot/upright_box"), load_task("spot/upright_box"))
    assert "it has no goal" in upright.apply(command("planner", "guidance", "object"), 0)
    assert upright.planner.guidance == "none"
