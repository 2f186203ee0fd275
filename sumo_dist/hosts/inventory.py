"""Hosts files: which machines a run has and what each of them carries. TOML files."""

import re
from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sumo_dist.errors import UsageError, unknown
from sumo_dist.rollout import ENGINES
from sumo_dist.tables import made, read_table
from sumo_dist.wire.keys import checked_name
from sumo_dist.wire.session import checked_endpoint, is_loopback, port_of

ROLES = ("router", "robot", "estimator", "optimizer", "tracer")
NEEDED = ("router", "robot", "optimizer")
THIS_MACHINE = "local"  # the name of the host that needs no ssh
DEFAULT_PORT = 7447

_VARIABLE = r"[A-Za-z_][A-Za-z0-9_]*"
_FOLDER = r"(~|~?/[^\x00-\x1f]*)"


@dataclass(frozen=True)
class Host:
    """A machine and what it does.

    Attributes:
        name: in the hosts file, and before each line that it says. "local" is this machine.
        roles: of ROLES. Where nobody has "estimator", the robot's host has it.
        workers: rollout workers on it.
        threads: rollout threads of each.
        ssh: destination as `ssh` takes it, such as user@host; by default its name, which may be one
            of ~/.ssh/config.
        ssh_port: 0 is ssh's own choice.
        ssh_options: further words for `ssh`, such as ["-i", "/a/key"].
        folder: on the host, for everything that is put there: absolute, or below ~.
        python: interpreter there that the environment in `folder` is made with.
        address: of the router's host: HOST or HOST:PORT by which all others reach the router.
        engine: kind of rollout engine, see rollout.make_engine; "" is that of the run.
        environment: variables for its services.
    """

    name: str
    roles: tuple[str, ...] = ()
    workers: int = 0
    threads: int = 1
    ssh: str = ""
    ssh_port: int = 0
    ssh_options: tuple[str, ...] = ()
    folder: str = "~/sumo-dist"
    python: str = "python3"
    address: str = ""
    engine: str = ""
    environment: tuple[tuple[str, str], ...] = ()

    def __post_init__(self) -> None:
        checked_name("host", self.name)
        self._check_roles()
        if self.engine and self.engine not in ENGINES:
            raise unknown("engine", self.engine, ENGINES)
        if re.search(r"\s|^-", self.ssh) or (self.is_local and self.ssh):
            raise UsageError(
                f"ssh needs a destination such as user@host, got {self.ssh!r}; "
                f"the host {THIS_MACHINE!r} needs none"
            )
        if not 0 <= self.ssh_port < 2**16:
            raise UsageError(f"ssh_port must be from 1 to 65535, got {self.ssh_port}")
        if not re.fullmatch(_FOLDER, self.folder):
            raise UsageError(f"folder must be absolute or begin with ~/, got {self.folder!r}")
        if not self.python or self.python.startswith("-"):
            raise UsageError(f"python must name an interpreter, got {self.python!r}")
        for name, value in self.environment:
            if not re.fullmatch(_VARIABLE, name) or "\0" in value:
                raise UsageError(f"environment: {name!r} is not the name of a variable")

    def _check_roles(self) -> None:
        for role in self.roles:
            if not isinstance(role, str) or role not in ROLES:
                raise unknown("role", str(role), ROLES)
        if len(set(self.roles)) < len(self.roles):
            raise UsageError(f"a role is named twice in {', '.join(self.roles)}")
        if not 0 <= self.workers <= 256:
            raise UsageError(f"workers must be from 0 to 256, got {self.workers}")
        if not 1 <= self.threads <= 256:
            raise UsageError(f"threads must be from 1 to 256, got {self.threads}")
        if not self.roles and not self.workers:
            raise UsageError(f"has nothing to do: give it roles ({', '.join(ROLES)}) or workers")
        if not all(isinstance(word, str) for word in self.ssh_options):
            raise UsageError(f"ssh_options must be words, got {list(self.ssh_options)}")
        if bool(self.address) != ("router" in self.roles):
            raise UsageError(
                'address = "HOST:PORT" belongs to the host of the router, and only there: it is '
                "how all others reach it"
            )

    @property
    def is_local(self) -> bool:
        """Whether it is this machine."""
        return self.name == THIS_MACHINE

    @property
    def is_vital(self) -> bool:
        """Whether a run cannot go on without it."""
        return bool({"router", "robot", "estimator", "optimizer"} & set(self.roles))


@dataclass(frozen=True)
class Inventory:
    """The hosts of a run.

    Attributes:
        hosts: in the order of the file.
        keys: folder that `sumo-dist keys` has made, with a certificate for each host and role.
        insecure: a router that other hosts reach may do without.
    """

    hosts: tuple[Host, ...]
    keys: str = ""
    insecure: bool = False

    def __post_init__(self) -> None:
        count = Counter(role for host in self.hosts for role in host.roles)
        for role in ROLES:
            if count[role] > 1 or (role in NEEDED and not count[role]):
                number = "one host" if role in NEEDED else "at most one host"
                raise UsageError(f"{number} has the role {role!r}, here {count[role]} have it")
        if not any(host.workers for host in self.hosts):
            raise UsageError("nobody rolls out: give a host workers = 1 or more")
        checked_endpoint(self.endpoint)
        if not (self.keys or self.insecure or self.is_loopback):
            raise UsageError(
                f"whoever reaches the router at {self.endpoint} would own the robot: give "
                'keys = "FOLDER" that `sumo-dist keys` made, or, on a network that nobody else is '
                "on, insecure = true"
            )

    def having(self, role: str) -> Host | None:
        """Return the host of a role, if there is one."""
        return next((host for host in self.hosts if role in host.roles), None)

    @property
    def endpoint(self) -> str:
        """How every host reaches the router."""
        router = self.having("router")
        assert router is not None, "it was checked"
        has_port = re.search(r"(?<=[^:]):\d+$|\]:\d+$", router.address)
        address = router.address if has_port else f"{router.address}:{DEFAULT_PORT}"
        return f"{'tls' if self.keys else 'tcp'}/{address}"

    @property
    def listen(self) -> str:
        """Where the router listens: all of its host's addresses, or loopback alone."""
        if self.is_loopback:
            return self.endpoint
        everywhere = "[::]" if "[" in self.endpoint else "0.0.0.0"
        return f"{self.endpoint.partition('/')[0]}/{everywhere}:{port_of(self.endpoint)}"

    @property
    def is_loopback(self) -> bool:
        """Whether only the router's host reaches it."""
        return is_loopback(self.endpoint)

    @property
    def address(self) -> tuple[str, int]:
        """Host and port of the router."""
        host = self.endpoint.partition("/")[2].rpartition(":")[0]
        return host.strip("[]"), port_of(self.endpoint)


def read_inventory(path: Path) -> Inventory:
    """Read a hosts file.

    Raises:
        UsageError: there is no such file, or it is none; the message names what is valid.
    """
    content = read_table(path, "hosts file")
    tables = content.pop("hosts", None)
    if not isinstance(tables, dict) or not all(isinstance(t, dict) for t in tables.values()):
        raise UsageError(f"{path}: hosts are tables, [hosts.NAME]")
    hosts = tuple(_host(path, name, table) for name, table in tables.items())
    try:
        inventory = made(Inventory, {**content, "hosts": hosts}, hosts=tuple)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from None
    if not inventory.keys:
        return inventory
    return replace(inventory, keys=str(path.parent / Path(inventory.keys).expanduser()))


def _host(path: Path, name: str, table: dict[str, Any]) -> Host:
    variables = table.pop("environment", {})
    try:
        if not isinstance(variables, dict):
            raise UsageError("environment is a table, NAME = value")
        if "name" in table:
            raise UsageError("its name is that of its table, [hosts.NAME]")
        environment = tuple((key, _text(value)) for key, value in variables.items())
        values = {**table, "name": name, "environment": environment}
        return made(Host, values, name=str)
    except UsageError as error:
        raise UsageError(f"{path}: host {name}: {error}") from None


def _text(value: object) -> str:
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise UsageError(f"environment: values are texts or numbers, got {value!r}")
    return str(value)
