"""Commands to a robot that works, over Zenoh: what they change, when, and that it repeats."""

import time
from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.cli import main
from sumo_dist.episode.command import Command
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.single import run_single
from sumo_dist.tasks import load_task
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.notices import CommandMessage, Health

pytestmark = [pytest.mark.slow, pytest.mark.timeout(180)]

SPEED = 0.3  # of the wall clock in realtime


@pytest.fixture(autouse=True)
def no_traceback(capfd):
    yield
    assert "Traceback" not in capfd.readouterr().err


class Script:
    """Gives commands at given ticks."""

    def __init__(self, *commands):
        self.left = list(commands)

    def take(self, tick, wait):
        due = [command for at, command in self.left if at == tick]
        self.left = [(at, command) for at, command in self.left if at != tick]
        return due

    def answer(self, command, tick, refusal):
        assert refusal == ""


def digests(recording):
    return recording.plan_digest, recording.state_digest


def test_changes_and_another_task_in_lockstep_repeat_bit_for_bit(
    robot_starts, config, capfd, assert_repeats
):
    """A weight, a parameter, settings, a task; a worker is killed amid it all."""
    system = robot_starts(time_limit=1.0)

    def ctl(*words):
        assert main(["ctl", *words, "--connect", system.endpoint]) == 0

    system.after_plan(1)
    assert system.command("pause").refusal == ""
    ctl("weight", "goal=80")
    ctl("step", "7")
    ctl("parameter", "goal=1,-0.5")
    system.kill("local-0")
    ctl("step", "6")
    assert system.command("planner", "rollouts", "14").refusal == ""
    ctl("step", "4")
    ctl("planner", "timestep=0.01")
    ctl("step", "5")
    ctl("weight", "gripper=2")
    ctl("resume")
    assert system.command("pause").refusal == ""  # wherever that is
    ctl("task", "spot/move_tire", "5")
    capfd.readouterr()
    code, last = system.finish(episode=2)
    assert (code, last["end_reason"]) == (1, "timeout")
    first, second = system.recording(1), system.recording(2)

    # What the two episodes were
    assert first.ending == f"replaced: task by {first.operator[-1]['sender']}"
    assert first.operator[-1]["name"] == "spot/move_tire"
    assert len(first.states) > 20
    goal = load_task("spot/move_box").table.terms.index("goal")
    weights = np.array(first.weights)[:, goal]
    assert {60.0, 80.0} >= set(weights)
    assert weights[-1] == 80.0
    assert np.array(first.parameters)[-1, :2].tolist() == [1.0, -0.5]
    assert first.rollouts[-1] == 14
    assert (last["task"], last["seed"], last["plans"]) == ("spot/move_tire", 5, 20)
    assert second.rollouts[0] == 14  # settings stay, costs are the task's own
    assert second.operator == []
    tire = load_task("spot/move_tire").table.defaults
    assert np.array_equal(second.weights[-1], tire.weights)
    assert second.config["episode"]["planner"]["timestep"] == 0.01

    # They repeat, and are what one process makes of the same commands at the same ticks
    assert_repeats(first)
    assert_repeats(second)
    at = [command["tick"] for command in first.operator if command["verb"] not in ("pause", "step")]
    changes = [
        Command(0, "t", "weight", "goal", "80"),
        Command(1, "t", "parameter", "goal", "1,-0.5"),
        Command(2, "t", "planner", "rollouts", "14"),
        Command(3, "t", "planner", "timestep", "0.01"),
        Command(4, "t", "weight", "gripper", "2"),
        Command(5, "t", "resume"),
        Command(6, "t", "task", "spot/move_tire", "5"),
    ]
    undisturbed = Script(*zip(at, changes, strict=True))
    episode = EpisodeConfig("spot/move_box", 1, config, time_limit=1.0)
    assert digests(run_single(episode, 1, operator=undisturbed)[0]) == digests(first)
    settings = replace(config, rollouts=14, timestep=0.01)
    episode = EpisodeConfig("spot/move_tire", 5, settings, time_limit=1.0)
    assert digests(run_single(episode, 2)[0]) == digests(second)


def test_a_paused_robot_moves_by_steps_alone(robot_starts, assert_repeats, expected_digests):
    system = robot_starts(time_limit=1.0)
    system.after_plan(3)
    assert system.command("step").refusal == "pause first: a step is of a robot that is paused"
    held = system.command("pause").tick
    time.sleep(0.5)
    assert system.command("step", value="7").tick == held

    def now():
        """The robot says the tick even where it refuses."""
        ack = system.command("step", value="none")
        assert ack.refusal == "step must be a whole number from 1 to 10000, got 'none'"
        return ack.tick

    def reaches(tick):
        deadline = time.monotonic() + 60.0
        while now() < tick:
            assert time.monotonic() < deadline
        time.sleep(0.3)
        return now()

    assert reaches(held + 7) == held + 7
    assert system.command("step").tick == held + 7  # one tick
    assert reaches(held + 8) == held + 8
    assert system.command("resume").tick == held + 8
    code, summary = system.finish()
    assert (code, summary["end_reason"]) == (1, "timeout")
    recording = system.recording()
    assert digests(recording) == expected_digests()  # a pause changes nothing
    verbs = [(command["verb"], command["tick"]) for command in recording.operator]
    assert verbs == [
        ("pause", held),
        ("step", held),
        ("step", held + 7),
        ("resume", held + 8),
    ]
    assert_repeats(recording)


def test_a_reset_begins_another_episode_with_its_seed(
    robot_starts, config, assert_repeats, eventually
):
    system = robot_starts(time_limit=0.5)
    system.after_plan(2)
    assert system.command("pause").refusal == ""
    assert system.command("weight", "goal", "75").refusal == ""
    assert system.command("reset", value="-1").refusal.startswith("seed must be a whole number")
    assert system.command("reset", value="7").refusal == ""
    code, summary = system.finish(episode=2)
    assert (code, summary["seed"], summary["end_reason"]) == (1, 7, "timeout")
    first, second = system.recording(1), system.recording(2)
    assert first.ending == "replaced: reset by tester"
    assert system.number == 2
    episode = EpisodeConfig("spot/move_box", 7, config, time_limit=0.5, weight=("goal=75.0",))
    assert digests(run_single(episode, 1)[0]) == digests(second)
    for recording in (first, second):
        assert_repeats(recording)


@pytest.mark.parametrize(
    ("verb", "name", "value", "reason"),
    [
        ("weight", "gaol", "1", "unknown cost term 'gaol'; valid: fall, goal, gripper, velocity"),
        ("weight", "goal", "nan", "weight of 'goal' must be a finite number"),
        ("parameter", "goal", "99,0", "parameter 'goal' must be from -8 to 8 m"),
        ("planner", "nodes", "6", "nodes cannot change while an episode runs"),
        ("planner", "rollouts", "many", "setting rollouts needs a value of type int"),
        ("task", "spot/none", "", "unknown task 'spot/none'; valid: "),
    ],
)
def test_a_command_that_cannot_be_carried_out_says_why(paused, verb, name, value, reason):
    before = paused.command("step", value="none").tick
    ack = paused.command(verb, name, value)
    assert ack.refusal.startswith(reason)
    assert ack.tick == before


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("def task(:", "SyntaxError"),
        ("def task(): return 1 / 0", "ZeroDivisionError"),
        (
            """
from dataclasses import replace
from sumo_dist.model.frames import FrameRef
from sumo_dist.tasks import load_task

def task():
    base = load_task("spot/move_box")
    return replace(base, frames={**base.frames, "aim": FrameRef("site", "nowhere")})
""",
            "unknown site 'nowhere'",
        ),
    ],
)
def test_a_task_that_is_broken_is_refused_before_the_episode_ends(paused, tmp_path, text, reason):
    file = tmp_path / "broken.py"
    file.write_text(text)
    assert reason in paused.command("task", str(file)).refusal
    assert paused.command("step", value="none").refusal.startswith("step must be")
    assert paused.number == 1


def test_a_command_that_comes_again_is_carried_out_once(robot_starts, commander, eventually):
    system = robot_starts(time_limit=1.0)
    system.after_plan(2)
    held = system.command("pause").tick
    steps = [system.command("step", value="3", number=100) for _ in range(4)]
    with Bus.dial(system.endpoint, "spot") as bus:
        for _ in range(20):  # and without waiting for the answers
            bus.publish(CommandMessage("any", 100, system.command.sender, "step", "", "3"))
        other = commander(bus, "somebody-else")
        assert other("step", value="none").refusal != ""
        assert {(ack.tick, ack.refusal) for ack in steps} == {(held, "")}
        assert eventually(lambda: other("step", value="none").tick == held + 3, 60.0)
        time.sleep(0.5)  # it stays there
        assert other("step", value="none").tick == held + 3
        assert other("step", value="2", number=100).tick == held + 3  # numbers are a sender's own
        assert eventually(lambda: other("step", value="none").tick == held + 5, 60.0)
    assert system.command("resume").tick == held + 5
    system.finish()
    verbs = [command["verb"] for command in system.recording().operator]
    assert verbs == ["pause", "step", "step", "resume"]


def test_a_robot_that_stays_waits_for_another_episode(robot_starts, eventually):
    system = robot_starts(time_limit=0.3, stay=True)
    with Bus.dial(system.endpoint, "spot") as bus:
        health = bus.newest(Health, address="robot")
        assert eventually(lambda: health.peek() and health.peek().mode == "ended", 60.0)
        refusal = "the episode has ended: reset, or give a task"
        assert system.command("pause").refusal == refusal
        assert system.command("task", "spot/none").refusal.startswith("unknown task")
        assert system.command("weight", "gaol", "70").refusal.startswith("unknown cost term")
        assert system.command("weight", "goal", "70").refusal == ""  # of the next episode
        assert system.command("planner", "rollouts", "8").refusal == ""
        assert system.command("reset", value="4").refusal == ""
        assert eventually(lambda: len(system.endings) == 2, 60.0)
        system.endings.clear()
        assert system.command("task", "spot/move_cone").refusal == ""
        system.after_plan(2, episode=3)
    system.processes["robot-interface"].terminate()
    _, summary = system.finish(episode=3)
    assert summary["task"] == "spot/move_cone"
    first, second = system.recording(1), system.recording(2)
    assert (first.ending, second.ending) == ("timeout", "timeout")
    goal = load_task("spot/move_box").table.terms.index("goal")
    assert (first.weights[-1][goal], second.weights[0][goal]) == (60.0, 70.0)
    assert (second.rollouts[0], system.recording(3).rollouts[0]) == (8, 8)
    assert first.operator == []


@pytest.mark.alone
def test_in_realtime_changes_count_and_a_pause_takes_no_robot_time(robot_starts, eventually):
    system = robot_starts(speed=SPEED, clock="realtime", time_limit=60.0)
    with Bus.dial(system.endpoint, "spot") as bus:
        health = bus.newest(Health, address="robot")
        system.after_plan(5)
        held = system.command("pause").tick
        assert eventually(lambda: health.peek() and health.peek().mode == "paused", 30.0)
        time.sleep(1.0)
        for verb, name, value in (
            ("weight", "goal", "80"),
            ("parameter", "goal", "0.5,0.5"),
            ("planner", "variance_last", "0.5"),
        ):
            ack = system.command(verb, name, value)
            assert (ack.tick, ack.refusal) == (held, "")
        assert system.command("step", value="4").tick == held
        assert eventually(lambda: system.command("step", value="none").tick == held + 4, 30.0)
        assert system.command("resume").tick == held + 4
        system.after_more_plans(10)
        assert system.command("reset", value="3").refusal == ""
        system.after_plan(6, episode=2)
    system.interrupt(episode=2)
    first, second = system.recording(1), system.recording(2)
    goal = load_task("spot/move_box").table.terms.index("goal")
    assert first.ending == "replaced: reset by tester"
    assert (first.weights[0][goal], first.weights[-1][goal]) == (60.0, 80.0)
    assert first.parameters[-1][:2].tolist() == [0.5, 0.5]
    assert second.weights[0][goal] == 80.0  # of a reset they stay
    assert second.config["episode"]["seed"] == 3
    assert second.config["episode"]["planner"]["variance_last"] == 0.5
    for recording in (first, second):
        assert np.array(recording.states)[:, 2].min() > 0.4
