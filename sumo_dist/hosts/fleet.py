"""A run on several hosts: starts its services by agents, watches them, stops all, fetches files."""

import queue
import time
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from typing import TextIO

from sumo_dist.errors import SumoError
from sumo_dist.hosts.inventory import Host, Inventory
from sumo_dist.hosts.link import Link, Said
from sumo_dist.hosts.orders import ROBOT, ROUTER, RUNS, carrier, orders
from sumo_dist.hosts.protocol import Order, starting
from sumo_dist.hosts.remote import Shell, printable, unreachable
from sumo_dist.hosts.task_files import TaskFiles
from sumo_dist.launch.deployment import Deployment
from sumo_dist.launch.launcher import FINISH_S, STOP_S, cause
from sumo_dist.terminal import say

HELLO_S = 60.0  # until an agent is there
READY_S = 60.0  # until the router listens
REDIAL_S = 2.0  # between two tries to reach a host that was lost
_STOPPED_S = STOP_S + 3.0
_POLL_S = 0.1
_VITAL = (ROUTER, "state-estimator", "optimizer")


class Fleet:
    """The agents of a run."""

    def __init__(
        self,
        inventory: Inventory,
        deployment: Deployment,
        run: str,
        task: TaskFiles | None,
        log: TextIO,
    ) -> None:
        """Dial all hosts.

        Args:
            inventory: of the hosts, which are prepared.
            deployment: what the run is.
            run: its name.
            task: copies of a user's task file, if it is one.
            log: gets what all services say.
        """
        self._inventory, self._deployment, self._run, self._task = inventory, deployment, run, task
        self._log = log
        self._said: SimpleQueue[Said] = SimpleQueue()
        self._folders: dict[str, str] = {}  # by host
        self._orders: dict[str, list[Order]] = {}
        self._redial: dict[str, tuple[float, Host]] = {}  # when to try, by host
        self._complaint: dict[str, str] = {}  # the last of ssh, by host
        self._ready: set[str] = set()
        self._ended: dict[str, int] = {}  # exit codes of the services that there is one of
        self._stopped: set[Link] = set()
        self._stopping = False
        self._links: dict[str, Link] = {}
        for host in inventory.hosts:
            self._dial(host)

    def run(self) -> int:
        """Start all services, wait for the robot to end, return its exit code.

        Raises:
            SumoError: a vital service or host was lost.
        """
        hosts = self._inventory.hosts
        if not self._wait(lambda: len(self._folders) == len(hosts), HELLO_S):
            silent = [host.name for host in hosts if host.name not in self._folders]
            raise SumoError(f"no answer within {HELLO_S:.0f} s from {', '.join(silent)}")
        found = orders(self._inventory, self._deployment, self._folders, self._run, self._task)
        router = carrier(self._inventory, ROUTER)
        assert router is not None, "it was checked"
        self._start(router, [order for order in found[router.name] if order.command == ROUTER])
        if not self._wait(lambda: ROUTER in self._ready, READY_S):
            raise SumoError(f"the router on {router.name} does not listen after {READY_S:.0f} s")
        keys = " --keys FOLDER (of the role operator)" if self._inventory.keys else ""
        say(f"to stop the robot: sumo-dist stop --connect {self._inventory.endpoint}{keys}")
        self._orders = {
            name: [order for order in all_ if order.command != ROUTER]
            for name, all_ in found.items()
        }
        for host in sorted(hosts, key=lambda host: "robot" in host.roles):  # the robot last
            self._start(host, self._orders[host.name])
        while ROBOT not in self._ended:
            self._turn()
        code = self._ended[ROBOT]
        if code < 0:
            raise SumoError(f"the robot's service ended with {cause(code)}")
        return code

    def stop(self) -> None:
        """Stop all services, the robot first: it sits down, and keeps its recording."""
        has_tracer = carrier(self._inventory, "tracer") and self._deployment.viewer is not None
        self._stopping = True
        if ROBOT in self._ended and has_tracer:
            self._wait(lambda: "tracer" in self._ended, FINISH_S)  # it ends by itself
        robot = [link for link in self._links.values() if "robot" in link.host.roles]
        for links in (robot, list(self._links.values())):
            for link in links:
                link.say({"stop": True})
            self._wait(lambda links=links: all(self._is_over(link) for link in links), _STOPPED_S)
        for link in self._links.values():
            if not self._is_over(link):
                say(f"{link.host.name}: does not say that its services have ended; they end alone")
            link.end()

    def collect(self) -> None:
        """Fetch what robot and tracer have written, and remove it there."""
        for host in self._inventory.hosts:
            if host in (carrier(self._inventory, ROBOT), carrier(self._inventory, "tracer")):
                shell, folder = Shell(host), f"{RUNS}/{self._run}"
                try:
                    shell.fetch(folder, self._deployment.out)
                    shell.must(f"rm -rf {folder}", f"remove {folder}")
                except SumoError as error:
                    say(f"{error}; what the run wrote there stays in {host.folder}/{folder}")

    def _dial(self, host: Host) -> None:
        self._links[host.name] = Link(host, self._run, self._said)

    def _start(self, host: Host, services: list[Order]) -> None:
        if services:
            self._links[host.name].say(starting(services))

    def _is_over(self, link: Link) -> bool:
        return link in self._stopped or link.is_lost

    def _wait(self, condition: Callable[[], bool], limit: float) -> bool:
        deadline = time.monotonic() + limit
        while not (met := condition()) and time.monotonic() < deadline:
            self._turn()
        return met

    def _turn(self) -> None:
        """Take what was said, and dial again whom it is time for."""
        with suppress(queue.Empty):
            self._take(self._said.get(timeout=_POLL_S))
        for name, (when, host) in list(self._redial.items()):
            if time.monotonic() >= when and not self._stopping:
                del self._redial[name]
                self._dial(host)

    def _take(self, said: Said) -> None:
        host, content = said.link.host, said.content
        if said.link is not self._links[host.name]:
            return  # of one that was given up
        service = str(content.get("service", ""))
        if said.event == "hello":
            self._on_hello(said.link, str(content["folder"]))
        elif said.event == "log":
            self._on_log(host, service, str(content["text"]))
        elif said.event == "ready":
            self._ready.add(service)
        elif said.event == "ended":
            self._on_end(host, service, int(content["code"]))
        elif said.event == "stopped":
            self._stopped.add(said.link)
        elif said.event == "lost":
            self._on_loss(host, str(content["why"]))

    def _on_hello(self, link: Link, folder: str) -> None:
        name = link.host.name
        if name in self._folders:
            say(f"{name} is back")
            self._start(link.host, self._orders.get(name, []))
        self._folders[name] = folder
        self._complaint.pop(name, None)

    def _on_log(self, host: Host, service: str, text: str) -> None:
        text = printable(text)
        if service == "ssh" and (host.name not in self._folders or host.name in self._complaint):
            self._complaint[host.name] = text  # said if it comes to nothing
            return
        line = f"{host.name}/{service}: {text}"
        say(line)
        with suppress(OSError):  # a full disk: a run is worth more than what is said of it
            self._log.write(f"{line}\n")
            self._log.flush()

    def _on_end(self, host: Host, service: str, code: int) -> None:
        self._ended[service] = code
        if self._stopping or service == ROBOT:
            return
        if service in _VITAL:
            raise SumoError(
                f"{service} on {host.name} ended with {cause(code)}; see its messages above"
            )
        if code != 0:
            say(f"sumo-dist: {service} on {host.name} ended ({cause(code)}), the run goes on")

    def _on_loss(self, host: Host, why: str) -> None:
        if self._stopping:
            return
        first = host.name not in self._complaint
        why = self._complaint.get(host.name) or why
        if host.name not in self._folders:
            raise unreachable(host, why)
        if host.is_vital:
            raise SumoError(f"lost {host.name} ({', '.join(host.roles)}): {why}")
        if first:
            say(f"sumo-dist: lost {host.name} ({why}), the run goes on; trying to reach it again")
        self._complaint.setdefault(host.name, why)
        self._redial[host.name] = time.monotonic() + REDIAL_S, host
