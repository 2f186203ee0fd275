"""How a service reaches its robot's bus: part of the options of every service."""

from dataclasses import dataclass

from sumo_dist.wire.bus import Bus
from sumo_dist.wire.keys import checked_robot
from sumo_dist.wire.session import DEFAULT_ENDPOINT, checked_endpoint


@dataclass(frozen=True, kw_only=True)
class Connection:
    """A robot's bus.

    Attributes:
        connect: the router's endpoint.
        robot: its name on the bus.
    """

    connect: str = DEFAULT_ENDPOINT
    robot: str = "spot"

    def __post_init__(self) -> None:
        checked_endpoint(self.connect)
        checked_robot(self.robot)

    def dial(self, run: str | None = None) -> Bus:
        """Connect, waiting for the router to come up; see `Bus.dial`."""
        return Bus.dial(self.connect, self.robot, run=run)
