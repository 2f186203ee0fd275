"""Which services a run has, and what each of them is told."""

from dataclasses import fields
from pathlib import Path

import pytest
import tyro

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import UsageError
from sumo_dist.launch import serve
from sumo_dist.launch.deployment import Deployment, services
from sumo_dist.launch.launcher import flags
from sumo_dist.planner.config import PlannerConfig

ENDPOINT = "tcp/127.0.0.1:7447"
FULL = EpisodeConfig(
    "g1/box_push",
    seed=2**62,
    planner=PlannerConfig("mppi", rollouts=7, horizon=0.4),
    clock="realtime",
    estimator="lowpass",
    time_limit=2.5,
    engine="fallback",
    plant="hard",
    weight=("goal=80.5", "pelvis=-1e-05"),
    param=("goal=-1.0,0.25", "success_speed=0.2"),
)
PLAIN = EpisodeConfig("spot/move_box")


def deployment(episode, **changes):
    parts = {"workers": 2, "threads": 3, "out": Path("/out"), "viewer": "none", "speed": None}
    return Deployment(episode, **{**parts, "wait": 7.0, **changes})


@pytest.mark.parametrize("episode", [FULL, PLAIN])
def test_the_robot_is_told_the_whole_episode(episode):
    """As words of a command line, which is how a process gets it."""
    *_, robot = services(deployment(episode, speed=0.5, resume_wait=2.0, stay=True), ENDPOINT)
    assert robot.command == "robot-interface"
    told = tyro.cli(serve.Robot, args=list(flags(robot.options)))
    assert told == robot.options
    assert told.episode == episode
    assert (told.robot, told.connect, told.out) == (
        episode.task.partition("/")[0],
        ENDPOINT,
        Path("/out"),
    )
    assert (told.speed, told.wait, told.resume_wait, told.stay) == (0.5, 7.0, 2.0, True)


def test_the_page_shows_the_view_unless_the_run_is_none_of_its():
    def named(**changes):
        run = services(deployment(PLAIN, keys=Path("/keys"), **changes), "tls/192.0.2.1:7448")
        return {service.name: service for service in run}

    steered = named(viewer="web")
    assert not steered["control"].vital
    assert steered["control"].options.keys == Path("/keys/operator")
    assert steered["control"].options.robot == "spot"
    assert steered["tracer"].options.viewer == "embedded"
    assert named(viewer="web", steered=False)["tracer"].options.viewer == "web"
    for other in (named(viewer="web", steered=False), named(viewer="native"), named(viewer=None)):
        assert "control" not in other


def test_only_the_robot_is_told_what_to_do():
    *others, _ = services(deployment(FULL), ENDPOINT)
    names = [service.name for service in others]
    assert names == ["tracer", "state-estimator", "optimizer", "local-0", "local-1"]
    for service in others:
        known = {field.name for field in fields(service.options)}
        assert not known & {"episode", "task", "seed", "run"}
        assert getattr(service.options, "robot", "g1") == "g1"  # a worker serves any
        parsed = tyro.cli(type(service.options), args=list(flags(service.options)))
        assert parsed == service.options
    assert [s.vital for s in others] == [False, True, True, False, False]
    assert {s.options.engine for s in others[2:]} == {"fallback"}


@pytest.mark.parametrize("give_way", [True, False])
def test_workers_give_way_unless_told_not_to(give_way):
    found = services(deployment(PLAIN, give_way=give_way), ENDPOINT)
    workers = [service for service in found if service.command == "rollout-worker"]
    assert [worker.options.give_way for worker in workers] == [give_way] * 2
    assert ("--no-give-way" in flags(workers[0].options)) is not give_way


def test_without_a_viewer_there_is_no_tracer():
    assert "tracer" not in [s.name for s in services(deployment(FULL, viewer=None), ENDPOINT)]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"wait": 0.0}, r"wait must be in \(0, 3600\] s, got 0.0"),
        ({"wait": float("nan")}, r"wait must be in \(0, 3600\] s"),
        ({"resume_wait": -1.0}, "resume-wait must be from 0 to 86400 s"),
        ({"resume_wait": float("inf")}, "resume-wait must be from 0 to 86400 s"),
    ],
)
def test_bad_values_say_what_is_valid(change, message):
    with pytest.raises(UsageError, match=message):
        deployment(PLAIN, **change)
