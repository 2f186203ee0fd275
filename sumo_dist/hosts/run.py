"""A run on the hosts of a file: prepared, run, and what came of it fetched."""

import secrets
import time

from sumo_dist.hosts.fleet import Fleet
from sumo_dist.hosts.inventory import Inventory
from sumo_dist.hosts.prepare import prepare
from sumo_dist.hosts.task_files import task_files
from sumo_dist.launch.deployment import Deployment
from sumo_dist.record.folders import SERVICES_LOG
from sumo_dist.terminal import say


def run_on_hosts(inventory: Inventory, deployment: Deployment) -> int:
    """Run a task on all hosts; return the robot's exit code.

    What robot and tracer write, and `services.log` with what all services said, come into the
    deployment's folder.

    Raises:
        SumoError: a host lacks something, or a vital service or host was lost.
    """
    episode = deployment.episode
    task = task_files(episode.task)
    run = f"{time.strftime('%Y%m%d-%H%M%S')}-{secrets.token_hex(2)}"
    if inventory.insecure and not inventory.keys and not inventory.is_loopback:
        say(f"INSECURE: whoever reaches {inventory.endpoint} can drive the robot (insecure = true)")
    prepare(inventory, episode.engine, deployment.viewer is not None, task)
    with open(deployment.out / SERVICES_LOG, "w", encoding="utf-8") as log:
        fleet = Fleet(inventory, deployment, run, task, log)
        try:
            return fleet.run()
        finally:
            fleet.stop()
            fleet.collect()
