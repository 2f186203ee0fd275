"""The text beside the picture: what is planned, with what, and what each colour means."""

from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.tasks.task import Task
from sumo_dist.view.marks import elite_count

_BEYOND_LATIN = "‐–—‘’“”•…→≤≥±°×·"  # signs that are told without a loss


def legible(text: str) -> str:
    """Replace what the viewer has no letters for.

    Its one font has no emoji and no Asian letters, and Rerun's native viewer ends when it meets
    one; a task's name, a cost term or an error may have any.
    """
    return "".join(c if ord(c) < 0x180 or c in _BEYOND_LATIN else "?" for c in text)


def scene(task: Task, episode: EpisodeConfig, left_out: str) -> str:
    """Explain the views, as Markdown; `left_out` names what the 3D view does not draw."""
    planner, chosen = episode.planner, elite_count(episode.planner)
    best = "best future" if chosen == 1 else f"{chosen} best futures"
    robot_goes = task.goal_frame == "base"
    rest = "the robot should go" if robot_goes else f"the {task.goal_frame} should come to rest"
    ways = "coloured lines" if task.movers else "blue line"
    whose = " and ".join(["robot", *task.movers]) if task.movers else "the robot"
    paths = ["the robot's base" if name == "base" else f"the {name}" for name in task.trails]
    trails = " and ".join(paths).replace("_", " ")
    goal = f"- **green target**: where {rest}\n" if task.goal else ""
    lacks = f"- not drawn: {left_out}\n" if left_out else ""
    return f"""\
**{task.name}**: 20 times a second {task.scene.robot.name.capitalize()} imagines
**{planner.rollouts} futures** of {planner.horizon:g} s, scores them, and follows the best it found
({planner.optimizer.upper()}, seed {episode.seed}, {episode.clock} clock).
- **thin lines**: where {trails} go in each future, from cheap
  (yellow) over green and blue to expensive (violet)
- **white lines**: the {best}
- **pale twin**, and pale lines: where the plan ends, and the way there
{goal}- **{ways} on the floor**: the way of {whose} so far
{lacks}
**Is it late?** *drive*: the plan's age stays below the grey line (grey lines are limits, here and
in other plots); the lane *plans* is green.\\
**Is the cost wrong?** *tune*: which term is large, and when; does noise at the knots reach far
enough; does the new plan cost less than the current one.\\
**Is the state or the model wrong?** *tune*: how far off the plan the robot is after 0.24 s; contact
forces are the planning model's own along the plan, not measured.\\
**Is a worker sick?** *fleet*: a lane for each, rollouts that came in time, messages lost.
"""


def cost(task: Task) -> str:
    """Return the task's cost table, as Markdown."""
    rows = "\n".join(f"| {t.name} | {t.weight:g} | {t.reduction} |" for t in task.cost)
    return f"| term | weight | over time |\n|---|---|---|\n{rows}\n"
