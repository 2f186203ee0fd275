"""Which services each host starts, with which words."""

from pathlib import Path

import pytest
import tyro

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.hosts.inventory import Host, Inventory
from sumo_dist.hosts.orders import certificates, orders
from sumo_dist.hosts.task_files import TaskFiles
from sumo_dist.launch import serve
from sumo_dist.launch.deployment import Deployment

OPTIONS = {
    "router": serve.Router,
    "rollout-worker": serve.Worker,
    "state-estimator": serve.Estimator,
    "optimizer": serve.Optimizer,
    "tracer": serve.Tracer,
    "robot-interface": serve.Robot,
}


def deployment(task="g1/box_push", viewer="none", **more):
    config = EpisodeConfig(task, seed=3)
    return Deployment(config, 0, 1, Path("/out"), viewer, speed=0.5, wait=7.0, stay=True, **more)


def hosts(*more, **keys):
    robot = Host("robot", ("robot",))
    brain = Host("brain", ("router", "optimizer"), workers=2, threads=3, address="10.0.0.2")
    return Inventory((robot, brain, *more), **(keys or {"insecure": True}))


def folders(inventory):
    return {host.name: f"/{host.name}" for host in inventory.hosts}


def told(order):
    return tyro.cli(OPTIONS[order.command], args=list(order.words))


def test_every_role_is_on_its_host_and_told_where_the_router_is():
    inventory = hosts(Host("far", ("estimator", "tracer"), workers=1, engine="fallback"))
    found = orders(inventory, deployment(), folders(inventory), "run")
    assert {name: [order.name for order in all_] for name, all_ in found.items()} == {
        "robot": ["robot-interface"],
        "brain": ["router", "worker-0", "worker-1", "optimizer"],
        "far": ["worker-0", "state-estimator", "tracer"],
    }
    router, first, second, optimizer = map(told, found["brain"])
    assert (router.listen, found["brain"][0].listens) == (
        "tcp/0.0.0.0:7447",
        "tcp/127.0.0.1:7447",
    )
    assert (first.name, second.name, first.threads) == ("brain-0", "brain-1", 3)
    assert (first.engine, optimizer.engine) == ("auto", "auto")
    worker, estimator, tracer = map(told, found["far"])
    assert (worker.name, worker.engine) == ("far-0", "fallback")
    assert tracer.out == Path("/far/runs/run")
    (robot,) = map(told, found["robot"])
    assert (robot.out, robot.speed, robot.wait, robot.stay) == (
        *(Path("/robot/runs/run"), 0.5, 7.0, True),
    )
    assert robot.episode == deployment().episode
    for one in (first, second, optimizer, worker, estimator, tracer, robot):
        assert one.connect == "tcp/10.0.0.2:7447"
        assert getattr(one, "robot", "g1") == "g1"


def test_the_robots_host_estimates_where_nobody_else_does():
    found = orders(hosts(), deployment(viewer=None), folders(hosts()), "run")
    assert [order.name for order in found["robot"]] == ["state-estimator", "robot-interface"]


def test_without_a_viewer_the_tracers_host_has_none():
    inventory = hosts(Host("far", ("tracer",), workers=1))
    found = orders(inventory, deployment(viewer=None), folders(inventory), "run")
    assert [order.name for order in found["far"]] == ["worker-0"]


def test_a_users_task_is_the_copy_on_the_robots_host():
    task = TaskFiles("tasks/0123", "my task.py", {})
    found = orders(
        hosts(), deployment("/mine/my task.py", robot="spot"), folders(hosts()), "run", task
    )
    assert told(found["robot"][-1]).episode.task == "/robot/tasks/0123/my task.py"


@pytest.mark.parametrize(
    ("host", "roles"),
    [("robot", ["robot"]), ("brain", ["optimizer", "router", "worker"]), ("far", ["robot"])],
)
def test_with_keys_each_service_has_its_roles_certificate(host, roles):
    inventory = hosts(Host("far", ("estimator",)), keys="/authority")
    assert inventory.endpoint == "tls/10.0.0.2:7447"
    assert certificates(inventory, next(h for h in inventory.hosts if h.name == host)) == roles
    found = orders(inventory, deployment(viewer=None), folders(inventory), "run")
    assert {told(order).keys for order in found[host]} == {
        Path(f"/{host}/keys/{host}/{role}") for role in roles
    }
    assert found["brain"][0].words[-1] == "--no-insecure"
