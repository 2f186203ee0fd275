"""Check of how long a task's plans take."""

import statistics
import time

import numpy as np

from sumo_dist.check.findings import Finding, verdict
from sumo_dist.check.subject import Subject
from sumo_dist.tasks import load_task

# The task of the same robot whose planning time is 1.
REFERENCES = {"spot": "spot/move_box", "g1": "g1/box_push"}
COST_LIMIT = 1.5  # planning time of any task over the reference's
ROUNDS = 5  # plans that are timed, of each task in turn


def speed(subject: Subject) -> Finding:
    """How long a planning iteration takes, against the reference's."""
    reference = REFERENCES.get(subject.task.scene.robot.name, REFERENCES["spot"])
    pair = subject, Subject(load_task(reference), subject.seeds)
    times: tuple[list[float], list[float]] = [], []
    with pair[0].problem.engine(1) as ours, pair[1].problem.engine(1) as theirs:
        evaluators = [
            one.evaluator(engine) for one, engine in zip(pair, (ours, theirs), strict=True)
        ]
        for turn in range(ROUNDS):
            for one, evaluator, spent in zip(pair, evaluators, times, strict=True):
                knots = one.knots(one.config.rollouts, np.random.default_rng(turn))
                began = time.process_time()
                one.costs(evaluator, one.starts[turn % one.seeds], knots)
                spent.append(time.process_time() - began)
    ratio = statistics.median(times[0]) / statistics.median(times[1])
    text = f"a planning iteration takes {ratio:.2f} times that of {reference}"
    return verdict(ratio <= COST_LIMIT, text, f"{text}, more than {COST_LIMIT:g}")
