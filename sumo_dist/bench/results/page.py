"""A suite's results as one web page that needs nothing else."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from pathlib import Path

from sumo_dist.bench.results import charts
from sumo_dist.bench.results.outcomes import Results, Row
from sumo_dist.bench.results.stats import ALPHA, fisher
from sumo_dist.bench.results.tables import FAILURE_HEAD, TABLE_HEAD, failure_lines, table_line
from sumo_dist.view.replay import STRIP

CSS = Path(__file__).with_name("page.css")
WORDS = ("task", "ended by", "last plan's costs")  # columns that are not aligned as numbers


def page(results: Results, strips: Mapping[str, bytes]) -> str:
    """Lay out a report.

    Args:
        results: what was found.
        strips: pictures (JPEG) of typical trials by the names of their recordings' folders.
    """
    title = f"{results.suite.name}: {results.suite.title}"
    body = (
        *_head(results),
        *_overview(results),
        *_times(results),
        *_endings(results),
        *_films(results, strips),
        *_failures(results),
        *_settings(results),
    )
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>\n{CSS.read_text('utf-8')}</style>\n</head>\n"
        f"<body>\n{chr(10).join(body)}\n</body>\n</html>\n"
    )


def _head(results: Results) -> Iterable[str]:
    yield f'<p class="kicker">sumo-dist benchmark, suite {escape(results.suite.name)}</p>'
    yield f"<h1>{escape(results.suite.title)}</h1>"
    first, *others = results.findings()
    yield f'<p class="lead">{escape(first)}</p>'
    yield from (f"<p>{escape(said)}</p>" for said in others)
    yield f"<pre><code>{escape(results.request['command'])}</code></pre>"
    about = {"code": "sumo_dist", "MuJoCo": "mujoco", "Python": "python", "machine": "machine"}
    rows = {name: "; ".join(results.made_by(key)) for name, key in about.items()}
    planner = "{optimizer}, {rollouts} rollouts of {horizon} s, {nodes} nodes, engine {engine}"
    yield _definitions({**rows, "planner": planner.format(**results.settings)})


def _overview(results: Results) -> Iterable[str]:
    yield "<h2>Success</h2>"
    yield (
        f'<p class="note">Published: {escape(results.suite.source)}; its intervals are computed '
        "from its counts. Intervals are Wilson's. In the table a rate is green where it is at "
        "least the published one, and red where it is less by more than chance allows (Fisher's "
        f"exact test, p &lt; {ALPHA:g}).</p>"
    )
    marks = {
        "here": charts.circle(11, 6, 5, "ours", "here"),
        "published": charts.diamond(11, 6, "published"),
    }
    if any(task.control for task in results.tasks):
        marks["the robot only stands"] = charts.cross(11, 6, "control", "standing")
    yield _legend(marks)
    yield f"<figure>{charts.success_and_time(results)}</figure>"
    yield _table(TABLE_HEAD, [table_line(task) for task in results.tasks], _rate_classes(results))


def _times(results: Results) -> Iterable[str]:
    yield "<h2>Completion time</h2>"
    yield (
        '<p class="note">Share of all trials that are solved by each time'
        + ("; dashed: the robot only stands" if any(t.control for t in results.tasks) else "")
        + ".</p>"
    )
    panels = "".join(f"<div>{charts.solved_by(results, task)}</div>" for task in results.tasks)
    yield f'<figure class="small">{panels}</figure>'


def _endings(results: Results) -> Iterable[str]:
    yield "<h2>How trials ended</h2>"
    swatch = '<rect class="bar {}" x="3" y="0" width="16" height="12" rx="2"/>'
    looks = charts.reason_looks(results)
    yield _legend({reason: swatch.format(look) for reason, look in looks.items()})
    yield f"<figure>{charts.endings(results)}</figure>"


def _films(results: Results, strips: Mapping[str, bytes]) -> Iterable[str]:
    if not strips:
        return
    yield "<h2>What it looks like</h2>"
    yield (
        '<p class="note">The success of median time and the first failure of the most common kind. '
        "Blue: the way of the robot; orange: the way of the object; green: the goal. "
        "<code>sumo-dist replay FOLDER</code> shows the whole trial.</p>"
    )
    for task in results.tasks:
        figures = [
            _strip(results, row, strips[name], kind)
            for row, kind in ((task.typical, "good"), (task.failure, "bad"))
            if row is not None and (name := results.recording(row).name) in strips
        ]
        if figures:
            yield f'<section class="film"><h3>{escape(task.name)}</h3>{"".join(figures)}</section>'


def _strip(results: Results, row: Row, picture: bytes, kind: str) -> str:
    end = row["robot_time_s"]
    said = f"solved in {end:.1f} s" if row["success"] else row["end_reason"]
    if not row["success"] and row["final_goal_distance_m"] is not None:
        said += f", object {row['final_goal_distance_m']:.2f} m from its goal"
    times = "".join(f"<span>{end * i / (STRIP - 1):.1f} s</span>" for i in range(STRIP))
    folder = results.recording(row).relative_to(results.folder)
    data = base64.b64encode(picture).decode()
    alt = f"{row['task']} seed {row['seed']}, {said}"
    return (
        f'<figure class="{kind}"><figcaption><span>seed {row["seed"]}: '
        f"<b>{escape(said)}</b></span><code>{escape(str(folder))}</code></figcaption>"
        f'<div class="pictures"><img alt="{escape(alt)}" src="data:image/jpeg;base64,{data}"></div>'
        f'<div class="times">{times}</div></figure>'
    )


def _failures(results: Results) -> Iterable[str]:
    failures = results.failures()
    if failures:
        yield "<h2>Trials that failed</h2>"
        yield _table(FAILURE_HEAD, list(failure_lines(failures)), {})


def _settings(results: Results) -> Iterable[str]:
    yield "<h2>Settings</h2>"
    yield '<p class="note">The same for every task.</p>'
    yield _definitions({k: str(v) for k, v in results.settings.items()}, "settings")


def _rate_classes(results: Results) -> dict[int, str]:
    """Class of the rate's cell by line: at least what is published, or less than chance allows."""
    classes = {}
    for i, task in enumerate(results.tasks):
        counts = (task.count.successes, task.figure.successes)
        if task.count.rate >= task.figure.rate:
            classes[i] = "at-least"
        elif fisher(counts, (task.count.trials, task.figure.trials)) < ALPHA:
            classes[i] = "below"
    return classes


def _table(
    head: Sequence[str], lines: Sequence[Sequence[str]], rate_classes: Mapping[int, str]
) -> str:
    """Lay out a table; `rate_classes` are of the column "rate"."""
    looks = ["" if name in WORDS else "number" for name in head]
    titles = "".join(
        f'<th class="{look}">{escape(name)}</th>' for name, look in zip(head, looks, strict=True)
    )
    rows = []
    for i, line in enumerate(lines):
        cells = ""
        for name, look, cell in zip(head, looks, line, strict=True):
            extra = f" {rate_classes.get(i, '')}" if name == "rate" else ""
            cells += f'<td class="{look}{extra}">{escape(cell)}</td>'
        rows.append(f"<tr>{cells}</tr>")
    return (
        f'<div class="scroll"><table><thead><tr>{titles}</tr></thead>'
        f"<tbody>{''.join(rows)}</tbody></table></div>"
    )


def _definitions(rows: Mapping[str, str], look: str = "") -> str:
    pairs = (f"<dt>{escape(k)}</dt><dd>{escape(v)}</dd>" for k, v in rows.items())
    return f'<dl class="{look}">{"".join(pairs)}</dl>'


def _legend(marks: Mapping[str, str]) -> str:
    items = (
        f'<span><svg viewBox="0 0 22 12">{mark}</svg>{escape(name)}</span>'
        for name, mark in marks.items()
    )
    return f'<div class="legend">{"".join(items)}</div>'
