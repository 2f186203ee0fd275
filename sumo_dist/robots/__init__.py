"""The robots, by name."""

from sumo_dist.errors import unknown
from sumo_dist.robots.robot import Robot
from sumo_dist.robots.spot import SPOT

ROBOTS = {robot.name: robot for robot in (SPOT,)}


def get_robot(name: str) -> Robot:
    """Return a robot by name; an unknown name is an error that lists the known ones."""
    if name not in ROBOTS:
        raise unknown("robot", name, ROBOTS)
    return ROBOTS[name]
