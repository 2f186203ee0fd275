"""Checks of where a task's episodes begin."""

import numpy as np

from sumo_dist.check.findings import Finding, verdict
from sumo_dist.check.subject import Subject
from sumo_dist.check.world import WATCHED_S
from sumo_dist.episode.assemble import draw_start
from sumo_dist.model.index import StateIndex

ARENA = 20.0  # no start is farther from the origin [m]
OVERLAP = 0.005  # contacts of a start are no deeper [m]


def reset(subject: Subject) -> Finding:
    """Is every start reached, and decided by its seed."""
    for seed, start in enumerate(subject.starts):
        if not np.array_equal(draw_start(subject.task, seed), start):
            return Finding("fail", f"seed {seed}: a second draw differs; draw from rng only")
    different = len({start.tobytes() for start in subject.starts})
    text = f"{subject.seeds} seeds, each drawn twice, {different} different starts"
    return verdict(different > 1, text, "every seed has the same start")


def start(subject: Subject) -> Finding:
    """Is every start a state that the world can be in, the robot standing and untouched."""
    for seed, state in enumerate(subject.starts):
        if reason := _misplaced(subject, state):
            return Finding("fail", f"seed {seed}: {reason}")
    index = StateIndex(subject.plant)
    poses = [s[index.pose(body)] for s in subject.starts for body in index.free_bodies]
    reach = np.abs(poses)[:, :2].max()
    return Finding("ok", f"all within {reach:.1f} m, none in contact with the robot")


def rest(subject: Subject) -> Finding:
    """Does every object stay where the reset puts it, the robot taken away."""
    world, names = subject.world, subject.world.objects
    if not names:
        return Finding("ok", "there is no object")
    for seed, state in enumerate(subject.starts):
        if moved := world.settle(state).moved:
            return Finding("fail", f"seed {seed}: without the robot, {moved}")
    moving = [n for n in names if all(world.moves(state, n) for state in subject.starts)]
    staying = [name for name in names if name not in moving]
    text = f"{', '.join(staying) or 'nothing'} stays for {WATCHED_S:g} s, the robot taken away"
    set_off = f"; set in motion on purpose: {', '.join(moving)}" if moving else ""
    return Finding("ok", text + set_off)


def unsolved(subject: Subject) -> Finding:
    """Is no start solved, and none a failure."""
    for seed, state in enumerate(subject.starts):
        success, failures = subject.referee.judge(state)
        if holding := [*(["success"] if success else []), *failures]:
            return Finding("fail", f"seed {seed}: {holding[0]} holds at the start")
    return Finding("ok", f"no start has: {', '.join(['success', *subject.task.failure])}")


def _misplaced(subject: Subject, state: np.ndarray) -> str:
    """Say what is wrong with a start, if anything."""
    index, robot = StateIndex(subject.plant), subject.task.scene.robot
    for body in index.free_bodies:
        pose = state[index.pose(body)]
        if np.abs(pose[:3]).max() > ARENA:
            return f"{body} is {np.abs(pose[:3]).max():.0f} m away; positions are in m"
        if abs(np.linalg.norm(pose[3:]) - 1.0) > 1e-6:
            return f"{body}'s quaternion has norm {np.linalg.norm(pose[3:]):.3g}, must be 1"
    if state[index.pose(robot.base)][2] <= robot.fall_height:
        return "the robot has fallen"
    data, root = subject.simulation(state), subject.plant.body(robot.base).id
    for contact in data.contact:
        geoms = [subject.plant.geom(i) for i in contact.geom]
        roots = {int(subject.plant.body_rootid[geom.bodyid[0]]) for geom in geoms}
        names = " and ".join(subject.plant.body(geom.bodyid[0]).name for geom in geoms)
        if contact.dist < -OVERLAP:
            return f"{names} overlap by {-contact.dist * 1e3:.0f} mm"
        if root in roots and not roots <= {root, 0}:
            return f"{names} touch"
    return ""
