"""A suite's results as one web page that needs nothing else. Needs the `bench` extra."""

import base64
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jinja2
from markupsafe import Markup

from sumo_dist.bench.results import charts
from sumo_dist.bench.results.outcomes import Results, Row, TaskResult
from sumo_dist.bench.results.stats import ALPHA, fisher
from sumo_dist.bench.results.tables import (
    FAILURE_HEAD,
    MOTION_HEAD,
    MOTION_NOTE,
    TABLE_HEAD,
    failure_lines,
    motion_lines,
    table_line,
)

WORDS = ("task", "ended by", "last plan's costs")  # columns that are not aligned as numbers
ABOUT = {"code": "sumo_dist", "MuJoCo": "mujoco", "Python": "python", "machine": "machine"}
PLANNER = "{optimizer}, {rollouts} rollouts of {horizon} s, {nodes} nodes, engine {engine}"
PICTURES = 6  # in a strip, see view.replay


def page(results: Results, strips: Mapping[str, bytes]) -> str:
    """Lay out a report.

    Args:
        results: what was found.
        strips: pictures (JPEG) of typical trials by the names of their recordings' folders.
    """
    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
    )
    about = {name: "; ".join(results.made_by(key)) for name, key in ABOUT.items()}
    return templates.get_template("page.html").render(
        suite=results.suite,
        findings=results.findings(),
        command=results.request["command"],
        about={**about, "planner": PLANNER.format(**results.settings)},
        alpha=ALPHA,
        words=WORDS,
        table_head=TABLE_HEAD,
        table_lines=[table_line(task) for task in results.tasks],
        rate_looks=[rate_look(task) for task in results.tasks],
        has_control=any(task.control for task in results.tasks),
        charts={
            "success": Markup(charts.success_and_time(results)),
            "solved_by": Markup(charts.solved_by(results)),
            "endings": Markup(charts.endings(results)),
        },
        motion_head=MOTION_HEAD,
        motion_note=MOTION_NOTE,
        motion_lines=[*motion_lines(results.tasks)],
        films=films(results, strips),
        failure_head=FAILURE_HEAD,
        failures=[*failure_lines(results.failures())],
        settings=results.settings,
    )


def films(results: Results, strips: Mapping[str, bytes]) -> dict[str, list[dict[str, Any]]]:
    """Return the strips of each task that has any: the typical success, then a failure."""
    found = {}
    for task in results.tasks:
        rows = [row for row in (task.typical, task.failure) if row is not None]
        shown = [
            film(results, row, strips[name])
            for row in rows
            if (name := results.recording(row).name) in strips
        ]
        if shown:
            found[task.name] = shown
    return found


def film(results: Results, row: Row, picture: bytes) -> dict[str, Any]:
    """Return what the page shows of a trial."""
    end = row["robot_time_s"]
    said = f"solved in {end:.1f} s" if row["success"] else row["end_reason"]
    if not row["success"] and row["final_goal_distance_m"] is not None:
        said += f", object {row['final_goal_distance_m']:.2f} m from its goal"
    return {
        "look": "good" if row["success"] else "bad",
        "seed": row["seed"],
        "said": said,
        "folder": results.recording(row).relative_to(results.folder),
        "jpeg": base64.b64encode(picture).decode(),
        "times": [f"{end * i / (PICTURES - 1):.1f} s" for i in range(PICTURES)],
    }


def rate_look(task: TaskResult) -> str:
    """Class of a rate's cell: at least what is published, or less than chance allows."""
    if task.count.rate >= task.figure.rate:
        return "at-least"
    counts = task.count.successes, task.figure.successes
    significant = fisher(counts, (task.count.trials, task.figure.trials)) < ALPHA
    return "below" if significant else ""
