"""Check of a task's identity: two fresh processes must make the same task of the same files.

Services on several hosts know a task by its hash; a number that is drawn when the file is read, or
a set whose order changes, would make each of them refuse the others.
"""

import json
import subprocess
import sys

from sumo_dist.check.findings import Finding
from sumo_dist.check.subject import Subject
from sumo_dist.costs.blame import defined
from sumo_dist.errors import SumoError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.fingerprint import fingerprint
from sumo_dist.planner.problem import Problem, planning_options
from sumo_dist.tasks import load_task
from sumo_dist.tasks.task import Task

PATIENCE_S = 300.0  # a machine that is busy starts a process slowly


def identity(subject: Subject) -> Finding:
    """Do two fresh processes make the same task of it."""
    command = [sys.executable, "-P", "-m", __name__, subject.task.source]
    running = [
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        for _ in range(2)
    ]
    try:
        one, other = (_answer(process) for process in running)
    finally:
        for process in running:
            process.kill()
            process.communicate()
    differing = [part for part in one if one[part] != other.get(part)]
    if not differing:
        return Finding("ok", f"hash {one['the task']} in two fresh processes")
    named = [part for part in differing if part != "the task"] or ["its model"]
    return Finding(
        "fail",
        f"{', '.join(named)} differs from process to process: draw no numbers when the file is "
        "read, and give sets an order",
    )


def parts(task: Task) -> dict[str, str]:
    """Digests of a task and, to say where two differ, of its functions."""
    problem = Problem.build(task, planning_options(PlannerConfig.resolve(task.planner)))
    functions = {term.what: term.residual for term in task.cost}
    functions |= {"reset": task.reset, "success": task.success}
    functions |= {f"failure {name!r}": test for name, test in task.failure.items()}
    named = {_named(name, defined(function)): function for name, function in functions.items()}
    others = {"its frames": task.frames, "its actions": task.actions, "its hold": task.success_hold}
    digests = {name: fingerprint(value) for name, value in {**named, **others}.items()}
    return {"the task": problem.hash, **digests}


def _named(name: str, place: str) -> str:
    return f"{name} ({place})" if place else name


def _answer(process: "subprocess.Popen[str]") -> dict[str, str]:
    out, err = process.communicate(timeout=PATIENCE_S)
    if process.returncode != 0:
        last = err.strip().splitlines()[-1:] or ["it said nothing"]
        raise SumoError(f"in a fresh process it does not load: {last[0]}")
    return json.loads(out.splitlines()[-1])  # a task may print


if __name__ == "__main__":
    sys.stdout.write(f"{json.dumps(parts(load_task(sys.argv[1])))}\n")
