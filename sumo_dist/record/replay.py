"""A recording in Rerun: as a file, or opened in a viewer."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.errors import SumoError, UsageError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.planner.plan import Plan
from sumo_dist.planner.report import PlanReport
from sumo_dist.record.recording import Recording
from sumo_dist.tasks import load_task

CANDIDATES_LIMIT = 60_000_000  # [bytes]


def episode(recording: Recording) -> EpisodeConfig:
    """Return what decided a recorded episode."""
    config = recording.config
    try:
        return EpisodeConfig(
            task=config["task"],
            seed=config["seed"],
            planner=PlannerConfig(**config["planner"]),
            clock=config["clock"],
            estimator=config["estimator"],
        )
    except (KeyError, TypeError) as error:
        raise UsageError(f"the recording's config lacks or has unknown fields: {error}") from None


def to_rrd(recording: Recording, path: Path, candidates_limit: int = CANDIDATES_LIMIT) -> None:
    """Write a recording as a Rerun file of bounded size.

    Args:
        recording: of any length.
        path: of the .rrd.
        candidates_limit: in a longer run, the candidates of only every so many plans are drawn
            [bytes].

    Raises:
        SumoError: the file cannot be written, or the `view` extra is not installed.
    """
    from sumo_dist.view.outputs import Outputs
    from sumo_dist.view.rrd_file import RrdFile
    from sumo_dist.view.run_logger import RunLogger

    config, troubles = episode(recording), list[str]()
    size = sum(traces.nbytes for traces in recording.traces)
    stride = max(1, -(-size // candidates_limit))
    with Outputs(path.parent.name, RrdFile(path, troubles.append)) as out:
        logger = RunLogger(out, load_task(config.task), config, distributed=False)
        for tick, state in enumerate(recording.states):
            logger.log_state(tick, state)
        for i, report in enumerate(reports(recording)):
            logger.log_plan(report)
            if i % stride == 0 and recording.traces:
                logger.log_candidates(report.plan.tick, recording.costs[i], recording.traces[i])
        logger.flush()
    if troubles:
        raise SumoError(troubles[0])


def reports(recording: Recording) -> Iterator[PlanReport]:
    """Yield the account of each recorded plan, as far as a recording has it."""
    planner = episode(recording).planner
    for i, number in enumerate(recording.plan_numbers):
        finite = np.isfinite(recording.costs[i])
        plan = Plan(
            int(number),
            int(recording.plan_ticks[i]),
            recording.knots[i],
            planner.horizon,
            planner.spline,
        )
        yield PlanReport(
            plan=plan,
            costs=np.where(finite, recording.costs[i], 0.0),
            finite=finite,
            terms=recording.terms[i],
            plan_ms=float(recording.plan_ms[i]),
            own_ms=0.0,
            failed=not finite.any(),
        )
