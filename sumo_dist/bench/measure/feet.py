"""G1's feet as they were in training: seven capsules each, where its model here has three."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

from sumo_dist.model.scene import ASSETS
from sumo_dist.robots.robot import Robot

HEIGHT = -0.025  # of the axes above the ankle's origin [m]
# Along x from and to, and y, of each axis [m]; those of the right foot are mirrored.
CAPSULES = (
    *((0.05, 0.1, -0.0265), (-0.044, 0.123, -0.018), (-0.052, 0.13, -0.01), (-0.054, 0.132, 0.0)),
    *((-0.052, 0.13, 0.01), (-0.044, 0.123, 0.018), (0.05, 0.1, 0.026)),
)
SIDES = {"left": 1.0, "right": -1.0}


def full_feet(robot: Robot, folder: Path) -> Robot:
    """Write a model of G1 with full feet into a folder; return the robot that has it."""
    tree = ElementTree.parse(ASSETS / robot.mjcf)
    for side, sign in SIDES.items():
        (ankle,) = tree.iterfind(f".//body[@name='{side}_ankle_roll_link']")
        for geom in ankle.findall("geom[@class='foot']"):
            ankle.remove(geom)
        for i, (start, end, y) in enumerate(CAPSULES, 1):
            line = f"{start} {sign * y} {HEIGHT} {end} {sign * y} {HEIGHT}"
            name = f"{side}_foot{i}_collision"
            ElementTree.SubElement(ankle, "geom", {"name": name, "class": "foot", "fromto": line})
    path = folder / "g1_full_feet.xml"
    tree.write(path)
    return replace(robot, mjcf=str(path))
