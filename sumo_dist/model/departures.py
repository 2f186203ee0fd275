"""What a planning model does without, each by name; the plant has all of it.

Rollouts compare plans with each other. What costs time in each of them and changes none of their
order may be left out: see docs/decisions/0018-the-planning-model.md.
"""

from collections.abc import Iterable
from itertools import combinations

import mujoco

from sumo_dist.errors import unknown
from sumo_dist.model.contacts import list_contacts

DRY = "dry friction"
SELF = "self-contact"
SEARCH = "contact search"
SOLVER = "solver defaults"
LEAN = (DRY, SELF, SEARCH, SOLVER)

SLIPPING = 2.0  # speed at which damping takes what dry friction takes at any speed [rad/s]
SPARSE = 40  # degrees of freedom from which sparse matrices are faster
PAIRS = 1000  # geom pairs beyond which a list of them saves nothing over MuJoCo's search


def compile_without(
    spec: mujoco.MjSpec, robot: mujoco.MjsBody, departures: Iterable[str]
) -> mujoco.MjModel:
    """Compile a scene without some of what the plant has.

    Args:
        spec: of the scene, which this changes.
        robot: its base.
        departures: of LEAN. Without "dry friction" the robot's joints are damped in its place;
            without "self-contact" its bodies pass through each other; without "contact search"
            contacts come from a list that is made once; without "solver defaults" the solver
            begins each step anew, solves all constraints at once, and with sparse matrices where
            that is faster.
    """
    departures = set(departures)
    if others := departures - set(LEAN):
        raise unknown("departure", min(others), LEAN)
    if DRY in departures:
        _damp(robot)
    if SELF in departures:
        _part(spec, robot)
    if SOLVER in departures:
        bits = mujoco.mjtDisableBit
        spec.option.disableflags |= bits.mjDSBL_WARMSTART | bits.mjDSBL_ISLAND
    model = list_contacts(spec, PAIRS) if SEARCH in departures else spec.compile()
    if SOLVER in departures and model.nv >= SPARSE:
        model.opt.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    return model


def _damp(robot: mujoco.MjsBody) -> None:
    for joint in robot.find_all("joint"):
        joint.damping[0] += joint.frictionloss / SLIPPING
        joint.frictionloss = 0.0


def _part(spec: mujoco.MjSpec, robot: mujoco.MjsBody) -> None:
    """Exclude contacts between the bodies of the robot."""
    known = {frozenset((exclude.bodyname1, exclude.bodyname2)) for exclude in spec.excludes}
    bodies = [body for body in (robot, *robot.find_all("body")) if body.geoms]
    for number, body in enumerate(bodies):
        body.name = body.name or f"floor/body_{number}"
    for one, other in combinations(bodies, 2):
        if frozenset((one.name, other.name)) not in known:
            spec.add_exclude(bodyname1=one.name, bodyname2=other.name)
