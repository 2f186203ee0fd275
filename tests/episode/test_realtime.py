"""The asynchronous episode without processes: a body that plays a story, a link in memory."""

import threading
import time
from collections import deque

import numpy as np
import pytest

from sumo_dist.episode.assemble import Episode
from sumo_dist.episode.command import Nobody
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End
from sumo_dist.episode.realtime import CALIBRATION_PLANS, Pace, RealtimeLoop, calibrate, guarded
from sumo_dist.errors import SumoError
from sumo_dist.math.rotations import from_rotation_vector
from sumo_dist.model.index import StateIndex
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.plant.scripted import ScriptedBody
from sumo_dist.robots.spot import SPOT
from sumo_dist.timing import PLAN_PERIOD, TICK, anchor_tick, plan_due

PLANNER = PlannerConfig(rollouts=6, horizon=0.2)
SPEED = 4.0  # robot time per wall time; slow enough for a busy machine to keep up with
SIT_TICKS = round((np.max(SPOT.safety.stop_s) + SPOT.safety.rest_s) / TICK)
RISE_TICKS = round(1.5 * SPOT.safety.rise_s / TICK)

pytestmark = pytest.mark.alone


class Link:
    """The rest of the system: estimates what it reads, plans to stand still at once."""

    def __init__(self, blind=(), plans=True, ask_s=0.0):
        self._blind, self._plans, self._ask_s = set(blind), plans, ask_s
        self._states, self._ready = deque(maxlen=1), deque()
        self.questions = []  # (tick, speed, cost)

    def send_readings(self, readings):
        if readings.tick not in self._blind:
            self._states.append((readings.tick, readings.truth))

    def newest_state(self, tick, patience):
        return self._states[0] if self._states else None

    def send_question(self, request, planner, speed):
        self.questions.append((request.tick, speed, request.cost))
        number = plan_due(request.tick)
        if self._plans and speed > 0 and number is not None:
            self._ready.append(self._report(request, number))

    def ask_plan(self, request, planner, clock):
        assert clock == "calibrate"
        time.sleep(self._ask_s)
        return self._report(request, request.number)

    def new_plans(self):
        reports = list(self._ready)
        self._ready.clear()
        return reports

    def _report(self, request, number):
        knots = np.zeros((PLANNER.nodes, 9), np.float32)
        plan = Plan(number, anchor_tick(number), knots, PLANNER.horizon, PLANNER.spline)
        costs, finite, terms = np.ones(6), np.ones(6, bool), np.ones(len(request.cost.weights))
        return PlanReport(
            *(plan, costs, finite, terms, request.cost.weights, request.cost.parameters),
            plan_ms=1.0,
            own_ms=1.0,
        )


@pytest.fixture
def index(plant):
    return StateIndex(plant.model)


@pytest.fixture
def solved(first_state, index):
    """The box at rest on its goal, the robot away."""
    state = first_state.copy()
    state[index.pose("body")][:2] = 3.0, 3.0
    state[index.pose("box")][:3] = 0.0, 0.0, 0.254
    return state


@pytest.fixture
def play(first_state):
    """Return a function that runs a story; it keeps loop, episode, what was told, and the link."""

    class Played:
        def __init__(self, states=(first_state,), operator=None, link=None, body=None, **changes):
            resume_wait = changes.pop("resume_wait", 0.0)
            config = EpisodeConfig(
                "spot/move_box", 1, PLANNER, **{"clock": "realtime", "time_limit": 0.4, **changes}
            )
            self.body = body or ScriptedBody(list(states), knows_truth=False)
            self.episode = Episode.assemble(config, self.body)
            self.link, self.told, self.stop = link or Link(), [], threading.Event()
            self.loop = RealtimeLoop(
                self.episode,
                self.link,
                operator or Nobody(),
                Pace(SPEED, resume_wait),
                self.stop,
                lambda level, text: self.told.append((level, text)),
            )

        def run(self):
            began = time.monotonic()
            self.ending = guarded(self.loop, self.episode)
            self.wall_s = time.monotonic() - began
            self.ending = self.episode.finish(self.ending, began)
            return self

        @property
        def recording(self):
            return self.episode.recording

    return Played


def test_time_runs_out_on_estimates_when_nobody_knows_the_truth(play, first_state):
    played = play().run()
    assert played.ending.reason == "timeout"
    assert not played.ending.sat_down
    assert played.body.truth is None
    assert np.array_equal(played.recording.states, [first_state] * 21)
    assert np.array_equal(played.recording.estimates, played.recording.states)
    assert len(played.body.sent) == 20
    assert np.array_equal(played.recording.targets, played.body.sent)
    assert played.told == []


def test_it_runs_at_its_pace(play):
    played = play().run()
    slipped = played.loop.slipped_s
    assert played.wall_s >= 20 * TICK / SPEED + slipped - 1e-3
    assert played.wall_s < 20 * TICK / SPEED + slipped + 5.0


def test_success_is_seen_on_estimates(play, first_state, solved):
    played = play([first_state] * 7 + [solved]).run()
    assert played.ending.kind is End.SUCCESS
    assert played.body.tick == 7
    assert played.recording.ending == "success"


def test_plans_are_taken_and_recorded(play):
    played = play().run()
    numbers = list(played.recording.plan_numbers)
    assert numbers == list(range(8))
    assert list(played.recording.plan_ticks) == [anchor_tick(number) for number in numbers]
    assert [tick for tick, _, _ in played.link.questions] == list(range(21))


def test_numbers_that_change_are_in_the_next_question(play, script):
    operator = script(t6=[["weight goal=5", "parameter goal=2,1"]])
    played = play(operator=operator).run()
    asked = {tick: cost for tick, _, cost in played.link.questions}
    assert (asked[6].weights[0], asked[7].weights[0]) == (60.0, 5.0)
    assert asked[7].parameters[:2].tolist() == [2.0, 1.0]
    made = dict(zip(played.recording.plan_ticks, played.recording.weights, strict=True))
    assert (made[5][0], made[7][0]) == (60.0, 5.0)
    assert [said["verb"] for said in played.recording.operator] == ["weight", "parameter"]


def test_without_plans_it_stands_and_says_so_once(play):
    played = play(link=Link(plans=False), time_limit=1.0).run()
    assert played.ending.reason == "timeout"
    assert played.told == []  # it stands from the start: no plan ran out
    late = Link()
    late.send_question = Stopping(late, 10)
    played = play(link=late, time_limit=1.0).run()
    assert played.told == [("warning", "the plan ran out: standing")]


class Stopping:
    """Questions that nobody answers from a tick on."""

    def __init__(self, link, tick):
        self._ask, self._tick = link.send_question, tick

    def __call__(self, request, planner, speed):
        self._ask(request, planner, speed if request.tick < self._tick else 0.0)


def test_a_stop_sits_the_robot_down(play, script):
    operator = script(t5=[["stop a dog"]])
    played = play(operator=operator).run()
    assert played.ending.reason == "stopped by ann: a dog, the robot sat down"
    assert played.ending.exit_code == 3
    assert played.told == [("error", "stopped by ann: a dog: sitting down")]
    assert len(played.body.sent) == 5 + SIT_TICKS
    assert np.allclose(played.body.sent[-1], SPOT.sit)
    steps = np.abs(np.diff(played.body.sent[5:], axis=0)).max()
    assert steps < 0.2  # a ramp, no jump
    assert len(played.recording.states) == 6 + SIT_TICKS - 1
    assert operator.answers == [("stop", 5, "")]


def test_while_it_sits_down_it_wants_no_plans_and_takes_no_commands(play, script):
    operator = script(t5=[["stop"]], t9=[["weight goal=1", "stop again"]])
    played = play(operator=operator).run()
    speeds = {tick: speed for tick, speed, _ in played.link.questions}
    assert (speeds[5], speeds[8]) == (SPEED, 0.0)
    assert operator.answers == [
        *(("stop", 5, ""), ("weight", 9, "the robot is stopping"), ("stop", 9, "")),
    ]
    assert played.ending.reason == "stopped by ann, the robot sat down"
    assert max(played.recording.plan_ticks) <= 5


def test_it_stands_up_again_when_it_is_told_to(play, script):
    sat = 5 + SIT_TICKS + 3
    operator = script(**{"t5": [["stop"]], f"t{sat}": [["stand"]]})
    limit = (sat + RISE_TICKS + 20) * TICK
    played = play(operator=operator, resume_wait=20.0, time_limit=limit).run()
    assert played.ending.reason == "timeout"
    assert operator.answers[-1] == ("stand", sat, "")
    assert played.told == [
        ("error", "stopped by ann: sitting down"),
        ("warning", "told to go on: getting up"),
    ]
    risen = played.body.sent[sat + RISE_TICKS - 1]
    assert np.allclose(risen, SPOT.stand)
    speeds = {tick: speed for tick, speed, _ in played.link.questions}
    assert speeds[sat + RISE_TICKS - 1] == 0.0
    assert speeds[sat + RISE_TICKS + 1] == SPEED
    assert max(played.recording.plan_ticks) > sat + RISE_TICKS


def test_only_stand_raises_it(play, script):
    sat = 5 + SIT_TICKS + 3
    commands = {f"t{sat}": [["weight goal=1", "resume", "reset", "stop"]]}
    operator = script(**{"t5": [["stop"]], **commands})
    played = play(operator=operator, resume_wait=1.0).run()
    assert played.ending.reason == "stopped by ann, the robot sat down"
    refused = "the robot has stopped: let it stand first"
    assert operator.answers[1:] == [
        *((verb, sat, refused) for verb in ("weight", "resume", "reset")),
        ("stop", sat, ""),
    ]


def test_it_does_not_get_up_from_its_side(play, script, first_state):
    tilted = first_state.copy()
    tilted[3:7] = from_rotation_vector(np.array([0.5, 0.0, 0.0]))
    sat = 5 + SIT_TICKS + 3
    operator = script(**{"t5": [["stop"]], f"t{sat}": [["stand"]]})
    played = play([first_state] * 6 + [tilted], operator=operator, resume_wait=1.0).run()
    refusal = "cannot go on: it lies 29 deg from level, at most 20"
    assert operator.answers[-1] == ("stand", sat, refusal)
    assert ("warning", refusal) in played.told
    assert played.ending.kind is End.STOPPED
    assert np.allclose(played.body.sent[-1], SPOT.sit)


def test_a_stop_while_it_rises_sits_it_down_again(play, script):
    sat = 5 + SIT_TICKS + 3
    operator = script(**{"t5": [["stop"]], f"t{sat}": [["stand"]], f"t{sat + 9}": [["stop no"]]})
    played = play(operator=operator, resume_wait=1.0).run()
    assert played.ending.reason == "stopped by ann: no, the robot sat down"
    assert len([text for _, text in played.told if "sitting down" in text]) == 2


def test_without_a_state_it_sits_down(play):
    """A short gap is bridged by the newest there is."""
    gap = round(SPOT.safety.blind_s / TICK)
    bridged = play(link=Link(blind=range(6, 6 + gap))).run()
    assert bridged.ending.reason == "timeout"
    lost = play(link=Link(blind=range(6, 1000))).run()
    assert lost.ending.reason == "fault: no state for 0.1 s, the robot sat down"
    assert lost.ending.exit_code == 3
    assert lost.body.tick == 6 + gap + SIT_TICKS
    assert np.allclose(lost.body.sent[-1], SPOT.sit)
    none = play(link=Link(blind=range(1000))).run()
    assert none.ending.reason == "fault: no state for 0.1 s, the robot sat down"
    assert len(none.recording.states) == 0


def test_a_state_that_is_not_finite_sits_it_down(play, first_state):
    wrong = first_state.copy()
    wrong[-1] = np.nan
    played = play([first_state] * 6 + [wrong] * 2 + [first_state]).run()
    assert played.ending.reason == "fault: the state is not finite, the robot sat down"
    assert np.isfinite(played.body.sent).all()


def test_a_fall_is_a_fall_and_no_fault(play, first_state):
    fallen = first_state.copy()
    fallen[3:7] = from_rotation_vector(np.array([1.5, 0.0, 0.0]))
    played = play([first_state] * 3 + [fallen], time_limit=5.0).run()
    assert played.ending.reason == "fell"
    assert played.ending.exit_code == 1


def test_a_body_that_fails_is_sat_down_without_any_state(play, first_state):
    class Failing(ScriptedBody):
        def read(self):
            if self.tick == 4:
                raise SumoError("no sensors")
            return super().read()

    played = play(body=Failing([first_state], knows_truth=False)).run()
    assert played.ending.reason == "fault: no sensors, the robot sat down"
    assert len(played.body.sent) == 4 + SIT_TICKS

    class Broken(ScriptedBody):
        def advance(self):
            if self.tick == 4:
                raise SumoError("a wire is off")
            super().advance()

    played = play(body=Broken([first_state], knows_truth=False)).run()
    assert played.ending.reason == "fault: a wire is off"
    assert not played.ending.sat_down


def test_a_pause_stops_the_clock(play, script):
    """The time of a pause is nobody's lateness, and the watchers see it."""
    modes = []

    class Watching(script):
        def take(self, tick, wait):
            if wait > 0:
                modes.append(played.loop.mode)
                time.sleep(0.1)
            return super().take(tick, wait)

    waits = [[]] * 4
    operator = Watching(t6=[["pause"], *waits, ["step"]], t7=[["resume"]])
    played = play(operator=operator)
    assert played.loop.mode == "running"
    played.run()
    assert played.ending.reason == "timeout"
    assert len(played.recording.states) == 21
    assert played.loop.slipped_s < 0.3  # a busy machine's
    assert played.wall_s > 20 * TICK / SPEED + 6 * 0.1 - 0.02
    assert modes == ["paused"] * 6
    assert played.loop.mode == "running"


def test_a_body_whose_time_cannot_be_held_is_not_paused(play, script, first_state):
    body = ScriptedBody([first_state], knows_truth=False)
    body.can_hold = False
    operator = script(t6=[["pause"]])
    assert play(body=body, operator=operator).run().ending.reason == "timeout"
    assert "cannot be held" in operator.answers[0][2]


@pytest.mark.parametrize("words", ["reset 4", "task spot/move_cone="])
def test_another_episode_ends_this_one_standing(play, script, words):
    played = play(operator=script(t6=[[words]])).run()
    assert played.ending.reason == f"replaced: {words.split()[0]} by ann"
    assert not played.ending.sat_down
    assert played.body.tick == 6
    assert played.episode.controls.following.clock == "realtime"


def test_it_ends_when_the_process_is_told_to(play):
    played = play(time_limit=60.0)
    threading.Timer(0.2, played.stop.set).start()
    played.run()
    assert played.ending.reason == "interrupted"
    assert played.ending.exit_code == 130
    assert played.wall_s < 10.0


def test_the_speed_fits_the_planner(play):
    """The p90 of the plans, the first few left out, takes a planning period of robot time."""
    state = np.zeros(3)
    slow = play(link=Link(ask_s=0.1))
    slow.body._states = [state]
    asked = []
    ask = slow.link.ask_plan

    def counted(request, planner, clock):
        asked.append(request.number)
        return ask(request, planner, clock)

    slow.link.ask_plan = counted
    assert 0.2 < calibrate(slow.episode, state, slow.link) <= PLAN_PERIOD / 0.1
    assert asked == list(range(CALIBRATION_PLANS))
    assert calibrate(play().episode, state, Link()) == 1.0
