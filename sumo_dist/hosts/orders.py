"""Which services each host of a run starts, with which options."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from sumo_dist.hosts.inventory import Host, Inventory
from sumo_dist.hosts.protocol import Order
from sumo_dist.hosts.task_files import TaskFiles
from sumo_dist.launch import serve
from sumo_dist.launch.deployment import Deployment, services
from sumo_dist.launch.launcher import dialled, flags
from sumo_dist.tasks import load_task

RUNS = "runs"  # in a host's folder
ROUTER = "router"
ROBOT = "robot-interface"
# command -> the role in the hosts file, and that of its certificate
PARTS = {
    ROUTER: ("router", "router"),
    ROBOT: ("robot", "robot"),
    "state-estimator": ("estimator", "robot"),
    "optimizer": ("optimizer", "optimizer"),
    "tracer": ("tracer", "tracer"),
}
WORKER = "rollout-worker"


def keys_of(host: Host) -> str:
    """Return where in its folder a host has its keys: other hosts' folders may be the same."""
    return f"keys/{host.name}"


def carrier(inventory: Inventory, command: str) -> Host | None:
    """Return the host that a service belongs to."""
    role, _ = PARTS[command]
    return inventory.having(role) or (inventory.having("robot") if role == "estimator" else None)


def certificates(inventory: Inventory, host: Host) -> list[str]:
    """Roles that a host needs a certificate for."""
    mine = {cert for command, (_, cert) in PARTS.items() if carrier(inventory, command) == host}
    return sorted(mine | ({"worker"} if host.workers else set()))


def orders(
    inventory: Inventory,
    deployment: Deployment,
    folders: Mapping[str, str],
    run: str,
    task: TaskFiles | None = None,
) -> dict[str, list[Order]]:
    """Return what each host starts, by its name: the router first, the robot last.

    Args:
        inventory: of the hosts.
        deployment: what the run is; its workers are those of the hosts.
        folders: of the hosts, by name, absolute.
        run: its name.
        task: copies of a user's task file that hosts have.
    """
    name = deployment.robot or load_task(deployment.episode.task).scene.robot.name
    found = {
        host.name: list(_workers(inventory, deployment, host, folders[host.name], task))
        for host in inventory.hosts
    }
    for command in PARTS:
        host = carrier(inventory, command)
        if host is None or command == ROUTER:
            continue
        local = _of_host(inventory, deployment, host, folders[host.name], run, name, task)
        found[host.name] += [
            Order(command, command, service.words)
            for service in services(local, inventory.endpoint)
            if service.command == command
        ]
    for all_ in found.values():
        all_.sort(key=lambda order: order.command == ROBOT)
    router = carrier(inventory, ROUTER)
    assert router is not None, "it was checked"
    found[router.name].insert(0, _router(inventory, router, folders[router.name]))
    return found


def _router(inventory: Inventory, host: Host, folder: str) -> Order:
    options = serve.Router(
        inventory.listen,
        keys=_keys(inventory, host, folder, "router"),
        insecure=inventory.insecure,
    )
    return Order(ROUTER, ROUTER, tuple(flags(options)), listens=dialled(inventory.listen))


def _workers(
    inventory: Inventory,
    deployment: Deployment,
    host: Host,
    folder: str,
    task: TaskFiles | None,
) -> Iterator[Order]:
    trust = () if task is None else (Path(folder, task.folder),)
    for number in range(host.workers):
        options = serve.Worker(
            connect=inventory.endpoint,
            keys=_keys(inventory, host, folder, "worker"),
            name=f"{host.name}-{number}",
            threads=host.threads,
            engine=host.engine or deployment.episode.engine,
            give_way=deployment.give_way,
            trust=trust,
        )
        yield Order(f"worker-{number}", WORKER, tuple(flags(options)))


def _of_host(
    inventory: Inventory,
    deployment: Deployment,
    host: Host,
    folder: str,
    run: str,
    robot: str,
    task: TaskFiles | None,
) -> Deployment:
    """Return the run as one of its hosts sees it."""
    episode = replace(deployment.episode, engine=host.engine or deployment.episode.engine)
    if task is not None:
        episode = replace(episode, task=f"{folder}/{task.folder}/{task.name}")
    return replace(
        deployment,
        episode=episode,
        workers=0,
        out=Path(folder, RUNS, run),
        robot=robot,
        keys=_keys(inventory, host, folder),
        steered=False,
    )


def _keys(inventory: Inventory, host: Host, folder: str, role: str = "") -> Path | None:
    """Where a host has its keys, or those of a role."""
    return Path(folder, keys_of(host), role) if inventory.keys else None
