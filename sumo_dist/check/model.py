"""Checks of what a task names: models that compile, frames that are there."""

from sumo_dist.check.findings import Finding, verdict
from sumo_dist.check.subject import Subject
from sumo_dist.model.index import StateIndex
from sumo_dist.model.scene import remarks
from sumo_dist.model.settle import height_above_floor


def model(subject: Subject) -> Finding:
    """Do the scene's models compile, does the policy fit the robot, can the objects touch."""
    plant, planning = subject.plant, subject.problem.model
    for body in StateIndex(plant).free_bodies:
        height_above_floor(plant, plant.qpos0, body)  # raises if there is nothing to measure from
    objects = ", ".join(thing.name for thing in subject.task.scene.objects) or "no object"
    size = f"{subject.task.scene.robot.name}, {objects}: nq {plant.nq}, nv {plant.nv}"
    text = "; ".join([size, *remarks(subject.task.scene)])
    return verdict(plant.nq == planning.nq, text, "plant and planning model differ in layout")


def frames(subject: Subject) -> Finding:
    """Are there all the sites and bodies that the task names."""
    known = {
        "site": {subject.plant.site(i).name for i in range(subject.plant.nsite)},
        "body": {subject.plant.body(i).name for i in range(subject.plant.nbody)},
    }
    missing = [
        f"{name} ({ref.kind} {ref.name!r})"
        for name, ref in subject.task.frames.items()
        if ref.name not in known.get(ref.kind, ())
    ]
    return verdict(not missing, ", ".join(subject.task.frames), f"not in the model: {missing}")
