"""The library as a script uses it: its own loop is the package's, to the last bit."""

from dataclasses import replace

import numpy as np
import pytest

import sumo_dist
from sumo_dist import MPC, Plant, Recording, UsageError, run_episode
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.timing import plan_due

QUICK = {"rollouts": 6, "horizon": 0.4}


def digests(recording):
    return recording.plan_digest, recording.state_digest, recording.ending, len(recording.states)


@pytest.fixture(scope="module")
def mpc():
    with MPC("spot/move_box", seed=2, planner=QUICK, threads=1) as mpc:
        yield mpc


@pytest.fixture
def state(mpc):
    return mpc.start(2)


def test_a_loop_of_ones_own_has_the_bits_of_an_episode(move_box, tmp_path):
    task = replace(move_box, time_limit=0.5, planner=QUICK)
    episode = run_episode(task, seed=2, weight={"goal": 80}, param={"goal": (1, 0.1)}, threads=1)
    with MPC(task, seed=2, weight={"goal": 80.0}, param={"goal": [1, 0.1]}, threads=2) as mpc:
        robot = Plant(task.scene, mpc.start(seed=2))
        while not (ending := mpc.ending(robot.truth)):
            robot.send(mpc.step(robot.truth))
            robot.advance()
    assert ending == "timeout"
    assert digests(mpc.recording) == digests(episode)
    assert mpc.recording.commands == episode.commands
    assert np.array(episode.weights)[0].tolist() == [80.0, *mpc.weights[1:]]
    mpc.recording.save(str(tmp_path / "run.npz"))
    for path in (tmp_path, str(tmp_path / "run.npz")):
        assert digests(Recording.load(path)) == digests(episode)


def test_an_episode_takes_names_files_and_tasks(move_box, tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(
        "from sumo_dist import load_task\ndef task(): return load_task('spot/move_box')"
    )
    short = {"planner": {**QUICK, "rollouts": 2}, "time_limit": 0.02, "threads": 1}
    runs = [run_episode(task, **short) for task in ("spot/move_box", file, str(file), move_box)]
    assert len({digests(run) for run in runs}) == 1
    assert [run.config["episode"]["task"] for run in runs] == [
        *("spot/move_box", str(file), str(file), "spot/move_box"),
    ]


def test_settings_are_the_defaults_the_tasks_and_those_given():
    with MPC("g1/box_push", planner={"optimizer": "icem", "nodes": 6}, threads=1) as mpc:
        planner = mpc.recording.config["episode"]["planner"]
    expected = PlannerConfig.preset("default", "icem").changed(
        {"horizon": 2.5, "base_noise": 1.0, "nodes": 6}
    )
    assert PlannerConfig.from_settings(planner) == expected


def test_a_plan_is_made_when_one_is_asked_for_and_not_twice_a_tick(state):
    with MPC("spot/move_box", seed=2, planner=QUICK, threads=1) as mpc:
        report = mpc.plan(state)
        assert (report.plan.number, report.plan.tick) == (0, 0)
        assert report.costs.shape == (6,)
        for _ in range(6):
            targets = mpc.step(state)
        assert targets.shape == (mpc.model.nu,)
        assert list(mpc.recording.plan_ticks) == [t for t in range(6) if plan_due(t) is not None]
        assert mpc.plan(state).plan.tick == mpc.tick == 6
        assert mpc.plan_now is not None and mpc.plan_now.number == 3


def test_commands_are_rolled_out_from_a_state(mpc, state):
    actions = mpc.task.actions
    stand = actions.to_command(np.tile(actions.default, (3, 10, 1)))
    rollouts = mpc.roll_out(state, stand)
    assert rollouts.states.shape == (3, 10, mpc.model.nq + mpc.model.nv)
    assert rollouts.valid.all()
    assert np.abs(rollouts.states[0, -1, :3] - state[:3]).max() < 0.1
    with pytest.raises(UsageError, match="commands has shape"):
        mpc.roll_out(state, stand[..., :-1])


def test_candidates_of_ones_own_are_costed(mpc, state):
    knots = np.zeros((2, 5, mpc.task.actions.size))
    knots[1] = 0.5
    evaluation = mpc.evaluate(state, knots)
    costs = evaluation.costs(mpc.weights)
    assert evaluation.terms.shape == (2, len(mpc.task.cost))
    assert costs.shape == (2,)
    assert costs[0] != costs[1]
    with pytest.raises(UsageError, match=r"they need \(rollouts, 5, "):
        mpc.evaluate(state, knots[:, :3])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "spot/fly"}, "unknown task 'spot/fly'; valid: .*spot/move_box"),
        ({"task": "nowhere.py"}, "nowhere.py does not exist"),
        ({"task": None}, "task must be a Task, a name or the path of a task file, got None"),
        ({"seed": "one"}, "seed must be a whole number, got 'one'"),
        ({"seed": -1}, "seed must be a whole number from 0"),
        ({"threads": 0}, "threads: 0; at least 1 is needed"),
        ({"threads": 1.5}, "threads must be a whole number, got 1.5"),
        ({"planner": {"rolouts": 3}}, "unknown setting 'rolouts'; valid: .*rollouts"),
        ({"planner": {"horizon": 0.5, "nodes": 0}}, "nodes must be from 1 to 100"),
        ({"planner": "rollouts=3"}, "planner must be values by name"),
        ({"task": "g1/door_open", "planner": {"guidance": "object"}}, "is not for task 'g1/door"),
        ({"weight": {"gaol": 3}}, "unknown cost term 'gaol'; valid: .*goal"),
        ({"weight": {"goal": "much"}}, "weight 'goal' must be a number or several, got 'much'"),
        ({"weight": {"goal": (1, 2)}}, "needs one number"),
        ({"weight": {"goal": float("nan")}}, "must be a finite number"),
        ({"weight": ["goal=3"]}, "weight must be values by name"),
        ({"param": {"goal": 1}}, "parameter 'goal' needs 2 finite numbers"),
        ({"param": {"goal": (99, 0)}}, "parameter 'goal' must be from -8 to 8 m"),
        ({"engine": "steam"}, "unknown engine 'steam'; valid: auto"),
    ],
)
def test_wrong_use_names_what_is_valid(arguments, message):
    given = {"task": "spot/move_box", "planner": QUICK, "threads": 1, **arguments}
    with pytest.raises(UsageError, match=message):
        run_episode(**given, time_limit=0.02)
    with pytest.raises(UsageError, match=message), MPC(**given) as mpc:
        mpc.plan(mpc.start())


@pytest.mark.parametrize(
    "wrong", [np.zeros(3), [], "x", None, np.full(44, np.nan), [[1.0], [2, 3]]]
)
def test_a_wrong_state_says_what_it_must_be(mpc, wrong):
    for ask in (mpc.plan, mpc.step, mpc.ending, lambda s: mpc.roll_out(s, np.zeros((1, 1, 1)))):
        with pytest.raises(UsageError, match=r"state must be \(\d+,\) "):
            ask(wrong)


def test_what_is_closed_says_so(state):
    mpc = MPC("spot/move_box", planner=QUICK, threads=1)
    mpc.plan(state)
    mpc.close()
    with pytest.raises(UsageError, match="closed"):
        mpc.plan(state)


def test_ctrl_c_ends_a_script_and_not_one_episode_of_it():
    def interrupt(_report):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_episode("spot/move_box", planner=QUICK, threads=1, on_plan=interrupt)


def test_the_package_offers_what_it_says():
    for name in sumo_dist._NAMES:
        assert getattr(sumo_dist, name) is not None
    assert {*sumo_dist._NAMES, "__version__"} <= set(dir(sumo_dist))
    with pytest.raises(AttributeError, match=r"no attribute .Simulator.; it offers: .*MPC"):
        sumo_dist.Simulator  # noqa: B018
