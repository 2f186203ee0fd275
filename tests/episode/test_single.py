"""The closed loop in one process: plan, policy, plant."""

import time
from dataclasses import replace

import numpy as np
import pytest

from sumo_dist.episode.again import repeat
from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.command import Nobody
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.local import LocalPlanning
from sumo_dist.episode.progress import Progress
from sumo_dist.episode.single import run_planned, run_single
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.plant.scripted import ScriptedBody
from sumo_dist.record.recording import Recording
from sumo_dist.record.rows import Rows
from sumo_dist.robots.guard import CommandGuard
from sumo_dist.robots.spot import SPOT
from sumo_dist.timing import anchor_tick

QUICK = PlannerConfig(rollouts=6, horizon=0.5)


def run(seed=1, time_limit=1.0, planner=QUICK, threads=1, **changes):
    config = EpisodeConfig(
        "spot/move_box", seed=seed, planner=planner, time_limit=time_limit, **changes
    )
    return run_single(config, threads)


def digests(recording):
    return recording.plan_digest, recording.state_digest


@pytest.fixture(scope="module")
def quick():
    recording, _ = run()
    return recording


def test_a_guided_episode_plans_otherwise_and_repeats(quick):
    guided = replace(QUICK, guidance="object")
    first, again = run(planner=guided)[0], run(planner=guided, threads=2)[0]
    assert digests(first) == digests(again) != digests(quick)
    assert first.config["episode"]["planner"]["guidance"] == "object"


@pytest.mark.parametrize("rate", [50, 7])
def test_plans_come_at_the_planners_rate_and_a_recording_repeats_them(rate):
    recording, _ = run(time_limit=0.3, planner=replace(QUICK, rate=rate))
    plans = [number for number in range(15) if anchor_tick(number, rate) < 15]
    assert list(recording.plan_numbers) == plans
    assert list(recording.plan_ticks) == [anchor_tick(number, rate) for number in plans]
    assert digests(repeat(recording)) == digests(recording)


@pytest.mark.slow
def test_two_seconds_with_default_settings():
    recording, ending = run(time_limit=2.0, planner=PlannerConfig(), threads=2)
    states = np.array(recording.states)
    assert ending.reason == "timeout"
    assert np.isfinite(states).all()
    assert states[:, 2].min() > 0.45  # the base stays up [m]
    base = states[:26, :3]  # the first 0.5 s
    assert np.abs(np.diff(base, axis=0)).max() < 0.02  # per tick [m]: 1 m/s
    assert np.linalg.norm(base[-1] - base[0]) < 0.3
    assert list(recording.plan_numbers) == list(range(40))
    assert list(recording.plan_ticks) == [anchor_tick(number) for number in range(40)]
    assert np.isfinite(recording.costs).all()


def test_every_plan_has_its_cpu_time_and_the_plant_has_none_of_it():
    before = time.process_time()
    recording, _ = run(time_limit=0.3, threads=2)
    process_ms = (time.process_time() - before) * 1e3
    assert len(recording.plan_cpu_ms) == len(recording.plan_numbers)
    assert min(recording.plan_cpu_ms) > 0
    assert sum(recording.plan_cpu_ms) < process_ms


def test_the_same_seed_gives_the_same_bits(quick):
    assert digests(run()[0]) == digests(quick)


def test_the_number_of_threads_changes_nothing(quick):
    assert digests(run(threads=3)[0]) == digests(quick)


def test_another_seed_gives_another_run(quick):
    recording, _ = run(seed=2)
    assert not np.array_equal(recording.states[0], quick.states[0])
    assert not set(digests(recording)) & set(digests(quick))


@pytest.mark.parametrize("optimizer", ["mppi", "cem"])
def test_every_optimizer_plans_and_repeats_itself(optimizer, quick):
    planner = PlannerConfig(optimizer, rollouts=6, horizon=0.5)
    recording, _ = run(planner=planner, time_limit=0.5)
    again, _ = run(planner=planner, time_limit=0.5)
    assert digests(recording) == digests(again)
    assert not np.array_equal(recording.knots[-1], quick.knots[len(recording.knots) - 1])


def test_lowpass_estimates_are_acted_on_and_repeat_themselves(quick):
    recording, ending = run(estimator="lowpass")
    assert ending.reason == "timeout"
    states, estimates = np.array(recording.states), np.array(recording.estimates)
    errors = np.abs(states - estimates)[:, :26]  # poses and joints
    assert 0 < errors.max() < 0.1
    assert states[:, 2].min() > 0.4
    assert digests(run(estimator="lowpass")[0]) == digests(recording)
    assert recording.state_digest != quick.state_digest


def test_truth_is_what_the_plant_is_in(quick):
    assert np.array_equal(quick.states, quick.estimates)


@pytest.mark.parametrize("spline", ["zero", "linear", "cubic"])
def test_every_spline_can_be_flown(spline):
    recording, ending = run(planner=PlannerConfig(spline=spline, rollouts=6, horizon=0.5))
    assert ending.reason == "timeout"
    assert np.array(recording.states)[:, 2].min() > 0.4


def test_candidates_lost_to_divergence_do_not_stop_the_run():
    """The finest of limits: one rollout an iteration, one knot to search, one tick of horizon."""
    planner = PlannerConfig(rollouts=2, nodes=3, horizon=0.02, iterations=2)
    recording, ending = run(planner=planner, time_limit=0.2)
    assert ending.reason == "timeout"
    assert np.isfinite(np.array(recording.knots)).all()


def test_realtime_needs_workers():
    with pytest.raises(UsageError, match="realtime clock plans asynchronously: it needs at least"):
        run(clock="realtime")


def test_weights_and_parameters_at_the_start_are_those_of_every_plan(quick):
    recording, _ = run(weight=("goal=0", "gripper=-90"), param=("goal=-3,2",))
    assert np.array(recording.weights).tolist() == [[0.0, -90.0, 20.0, 2500.0]] * 20
    assert np.array(recording.parameters).tolist() == [[-3.0, 2.0, 0.1, 0.05]] * 20
    assert not np.array_equal(recording.knots[0], quick.knots[0])
    assert np.array(quick.weights)[-1].tolist() == [60.0, 4.0, 20.0, 2500.0]
    assert np.array(recording.terms)[:, 0].tolist() == [0.0] * 20


def test_what_is_sent_is_recorded(quick):
    assert len(quick.targets) == quick.commands["sent"] == 50
    assert np.isfinite(np.array(quick.targets)).all()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"weight": ("gaol=1",)}, "unknown cost term 'gaol'"),
        ({"param": ("goal=1",)}, "parameter 'goal' needs 2 finite numbers"),
    ],
)
def test_numbers_that_are_not_the_tasks_are_refused_before_the_start(change, message):
    with pytest.raises(UsageError, match=message):
        run(**change)


def test_progress_tells_of_the_cost_every_two_seconds():
    lines = []
    config = EpisodeConfig("spot/move_box", seed=1, planner=QUICK, time_limit=2.1)
    run_single(config, 1, Progress(["goal", "gripper", "velocity", "fall"], lines.append))
    assert len(lines) == 2
    assert lines[0].startswith("  0.0 s  cost ")
    assert lines[1].startswith("  2.0 s  cost ")
    assert "goal" in lines[0]
    assert "plan" in lines[0]


def operated(script, time_limit=0.5, on_plan=lambda _report: None, threads=1, **changes):
    config = EpisodeConfig("spot/move_box", 1, QUICK, time_limit=time_limit, **changes)
    return run_single(config, threads, on_plan, script)


def test_a_pause_and_steps_change_nothing_of_the_run(script):
    plain, _ = operated(None)
    operator = script(t3=[["pause"], [], ["step 2"]], t5=[["step"]], t6=[["step", "resume"]])
    paused, ending = operated(operator)
    assert ending.reason == "timeout"
    assert digests(paused) == digests(plain)
    assert [(said["tick"], said["verb"]) for said in paused.operator] == [
        *((3, "pause"), (3, "step"), (5, "step"), (6, "step"), (6, "resume")),
    ]


def test_a_weight_and_a_goal_count_from_the_next_plan_on(script):
    operator = script(t6=[["weight gripper=-50", "parameter goal=2,1"]])
    changed, _ = operated(operator)
    plain, _ = operated(None)
    assert list(changed.plan_ticks) == list(plain.plan_ticks)
    first = list(changed.plan_ticks).index(7)
    for i, (weights, parameters) in enumerate(
        zip(changed.weights, changed.parameters, strict=True)
    ):
        later = i >= first
        assert weights[1] == (-50.0 if later else 4.0)
        assert parameters[:2].tolist() == ([2.0, 1.0] if later else [0.0, 0.0])
        assert np.array_equal(changed.knots[i], plain.knots[i]) != later


def test_fewer_rollouts_and_another_optimizer_are_taken_up(script):
    operator = script(t6=[["planner rollouts=4"]], t11=[["planner optimizer=mppi"]])
    recording, _ = operated(operator)
    counts = dict(zip(recording.plan_ticks, recording.rollouts, strict=True))
    assert {tick: counts[tick] for tick in (5, 7, 12)} == {5: 6, 7: 4, 12: 4}
    other, _ = operated(script(t6=[["planner rollouts=4"]]))
    differs = [not np.array_equal(a, b) for a, b in zip(recording.knots, other.knots, strict=True)]
    assert differs.index(True) == list(recording.plan_ticks).index(12)
    assert np.array(recording.traces).shape[:2] == (len(differs), 6)
    assert np.isfinite(np.array(recording.costs)).sum(axis=1)[2:4].tolist() == [6, 4]


def test_another_timestep_of_the_planning_model_is_taken_up(script):
    recording, ending = operated(script(t6=[["planner timestep=0.005"]]))
    assert ending.reason == "timeout"
    assert digests(repeat(recording)) == digests(recording)
    plain, _ = operated(None)
    same = (np.array(recording.terms) == np.array(plain.terms)).all(axis=1)
    assert same.tolist() == [tick < 6 for tick in recording.plan_ticks]


def test_a_goal_is_judged_as_it_is_at_the_moment(script):
    """The box is where it is: success comes when the goal does."""
    place = run(time_limit=0.1)[0].states[-1][26:28]
    operator = script(t5=[[f"parameter goal={float(place[0])!r},{float(place[1])!r}"]])
    recording, ending = operated(operator)
    assert ending.reason == "success"
    assert len(recording.states) == 7  # ticks 0 to 6


def test_a_stop_sits_the_robot_down(script):
    recording, ending = operated(script(t10=[["stop a dog"]]))
    assert ending.reason == "stopped by ann: a dog, the robot sat down"
    assert ending.exit_code == 3
    assert recording.ending == ending.reason
    assert recording.states[10][2] > 0.45
    assert recording.states[-1][2] < 0.35
    assert np.allclose(recording.targets[-1], SPOT.sit)


@pytest.mark.parametrize(
    ("words", "task"), [("reset 9", "spot/move_box"), ("task spot/move_cone=9", "spot/move_cone")]
)
def test_another_episode_replaces_this_one(script, words, task):
    config = EpisodeConfig("spot/move_box", 1, QUICK, time_limit=0.5)
    episode = Episode.assemble(config)
    with LocalPlanning(episode.problem, config, 1) as planning:
        ending = run_planned(episode, planning, script(t5=[["weight goal=7"], []], t8=[[words]]))
    assert ending.reason == f"replaced: {words.split()[0]} by ann"
    assert ending.exit_code == 1
    assert episode.body.tick == 8
    following = episode.controls.following
    assert (following.task, following.seed) == (task, 9)
    assert following.weight == (("goal=7.0",) if task == "spot/move_box" else ())


RUNS = {
    "numbers": {"t3": [["weight gripper=-50", "weight fall=-1"]], "t9": [["parameter goal=2,-1"]]},
    "planner": {"t4": [["planner rollouts=4"]], "t10": [["planner optimizer=ps"]]},
    "time": {"t3": [["pause"], ["weight gripper=-50"], ["step 2"]], "t5": [["step", "resume"]]},
    "stop": {"t6": [["weight gripper=-50"]], "t12": [["stop"]]},
    "reset": {"t6": [["weight gripper=-50"]], "t12": [["reset 4"]]},
    "interrupted": {"t6": [["weight gripper=-50"]], "t12": [[KeyboardInterrupt()]]},
    "interrupted paused": {"t6": [["pause", "weight goal=0"], [], [KeyboardInterrupt()]]},
}


@pytest.mark.parametrize("name", RUNS)
def test_a_recorded_run_repeats_with_its_commands(script, name, tmp_path):
    """From the file, as anybody may who has it."""
    recording, ending = operated(
        script(**RUNS[name]), plant="perturbed", estimator="lowpass", weight=("gripper=5",)
    )
    recording.save(tmp_path / "run.npz")
    again = repeat(Recording.load(tmp_path / "run.npz"))
    assert digests(again) == digests(recording)
    assert again.operator == recording.operator
    assert np.array_equal(again.weights, recording.weights)
    assert np.array_equal(again.parameters, recording.parameters)
    assert again.ending == recording.ending == ending.reason


@pytest.mark.parametrize("after", [0, 3])
def test_a_run_that_was_interrupted_while_it_planned_repeats(script, after):
    """With a command, or without one, in its last tick."""

    def give_up(report):
        if report.plan.tick == 7:
            raise KeyboardInterrupt

    recording, ending = operated(script(**{f"t{7 - after}": [["weight goal=5"]]}), on_plan=give_up)
    assert ending.reason == "interrupted"
    assert (len(recording.states), len(recording.plan_numbers)) == (8, 3)
    again = repeat(recording)
    assert digests(again) == digests(recording)
    assert len(again.traces) == 3


def test_a_run_that_was_interrupted_after_a_plan_repeats(script, monkeypatch):
    monkeypatch.setattr(CommandGuard, "send", interrupted_at(8, CommandGuard.send))
    recording, ending = operated(script())
    monkeypatch.undo()
    assert ending.reason == "interrupted"
    assert (len(recording.states), len(recording.plan_numbers)) == (8, 4)  # with the plan of 7
    assert digests(repeat(recording)) == digests(recording)


def interrupted_at(count, send):
    """Make a method raise at a call as Ctrl-C would."""
    calls = iter(range(1, count + 1))

    def method(self, targets):
        if next(calls) == count:
            raise KeyboardInterrupt
        return send(self, targets)

    return method


@pytest.mark.parametrize("what", ["state", "weight", "command"])
def test_a_recording_that_was_tampered_with_does_not_repeat(script, what):
    recording, _ = operated(script(t3=[["weight gripper=-50"]]))
    if what == "state":
        states = np.array(recording.states)
        states[9, 0] = np.nextafter(states[9, 0], 1e9)
        recording.states = Rows(states)
    elif what == "weight":
        recording.operator[0]["value"] = "50"
    else:
        recording.operator.clear()
    again = repeat(recording)
    assert digests(again) != digests(recording)


def test_a_command_that_fits_no_more_is_an_error_of_the_repeated_run(script):
    recording, _ = operated(script(t3=[["weight goal=5"]]))
    recording.operator[0]["name"] = "gaol"
    again = repeat(recording)
    assert again.ending == (
        "fault: tick 3: weight, carried out before, is refused: "
        "unknown cost term 'gaol'; valid: fall, goal, gripper, velocity"
    )


def test_a_realtime_run_cannot_be_repeated(quick):
    episode = {**quick.config["episode"], "clock": "realtime"}
    with pytest.raises(UsageError, match="only lockstep episodes repeat"):
        repeat(replace(quick, config={**quick.config, "episode": episode}))


def test_a_body_that_is_given_is_what_the_episode_runs_on(first_state):
    """Lockstep on a recorded motion: estimates are the body's readings, targets go to it."""
    config = EpisodeConfig("spot/move_box", 1, QUICK, time_limit=0.2)
    moving = [first_state.copy() for _ in range(11)]
    for tick, state in enumerate(moving):
        state[26] += 0.01 * tick
    body = ScriptedBody(moving, knows_truth=False)
    episode = Episode.assemble(config, body)
    with LocalPlanning(episode.problem, config, 1) as planning:
        ending = run_planned(episode, planning, Nobody())
    assert ending.reason == "timeout"
    assert np.array_equal(episode.recording.states, moving)
    assert np.array_equal(episode.recording.estimates, moving)
    assert np.array_equal(episode.recording.targets, body.sent)
    assert len(body.sent) == 10


def test_a_body_at_its_end_is_a_fault(first_state):
    class Broken(ScriptedBody):
        def advance(self):
            if self.tick == 3:
                raise SumoError("a wire is off")
            super().advance()

    config = EpisodeConfig("spot/move_box", 1, QUICK, time_limit=0.2)
    episode = Episode.assemble(config, Broken([first_state]))
    with LocalPlanning(episode.problem, config, 1) as planning:
        ending = run_planned(episode, planning, Nobody())
    assert (ending.reason, ending.exit_code) == ("fault: a wire is off", 3)
    assert episode.recording.ending == "fault: a wire is off"
