"""How a service reaches its robot's bus: part of the options of every service."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

from sumo_dist.authority.folder import KeyFolder
from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import checked_robot
from sumo_dist.wire.session import DEFAULT_ENDPOINT, checked_endpoint, is_secure


@dataclass(frozen=True, kw_only=True)
class Connection:
    """A robot's bus.

    Attributes:
        connect: the router's endpoint.
        keys: folder with ca.pem, cert.pem and key.pem, for endpoints with TLS.
        robot: its name on the bus.
    """

    role: ClassVar[str]  # that the keys must be for
    connect: str = DEFAULT_ENDPOINT
    keys: Path | None = None
    robot: str = "spot"

    def __post_init__(self) -> None:
        checked_endpoint(self.connect)
        checked_robot(self.robot)

    def dial(self, run: str | None = None) -> Bus:
        """Connect, waiting for the router to come up; see `Bus.dial`."""
        keys = keys_for(self.connect, self.keys, self.role)
        return Bus.dial(self.connect, self.robot, run=run, keys=keys)


def keys_for(endpoint: str | None, folder: Path | None, *roles: str) -> KeyFolder | None:
    """Read the keys that an endpoint needs; None if it needs none.

    Args:
        endpoint: to dial, or to listen on; None for those of this machine.
        folder: that was given for them.
        roles: that they may be for; any without.

    Raises:
        KeysError: they are not fit for it.
    """
    if folder is None or (endpoint is not None and not is_secure(endpoint)):
        return None
    return KeyFolder.read(folder, roles)
