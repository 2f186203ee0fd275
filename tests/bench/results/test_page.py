import json
import re
from html.parser import HTMLParser
from xml.etree import ElementTree

import pytest

from sumo_dist.bench.results import publish
from sumo_dist.bench.results.outcomes import JOURNAL, REQUEST, Results
from sumo_dist.bench.results.page import PICTURES, page
from sumo_dist.bench.results.tables import text
from sumo_dist.errors import SumoError
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.view import replay

BOX, TIRE = "spot/move_box", "spot/upright_tire"


@pytest.fixture
def results(tmp_path, make_row):
    rows = [
        *(make_row(BOX, seed, 4.0 + seed) for seed in range(1, 20)),
        make_row(BOX, 20, reason="rolled < away"),
        *(make_row(TIRE, seed, 3.0) for seed in range(1, 5)),
        *(make_row(TIRE, seed, reason="fell") for seed in range(5, 21)),
        *(make_row(TIRE, seed, variant="standing") for seed in range(1, 20)),
        make_row(TIRE, 20, 1.0, variant="standing"),
    ]
    (tmp_path / JOURNAL).write_text("".join(json.dumps(row) + "\n" for row in rows))
    request = {"suite": "paper-analysis", "command": "sumo-dist <x>", "tasks": [BOX, TIRE]}
    (tmp_path / REQUEST).write_text(json.dumps({**request, "trials": 20, "seed0": 1}))
    return Results.load(tmp_path)


class Tags(HTMLParser):
    """Fails on tags that do not nest, and keeps attributes and words."""

    VOID = ("meta", "img")

    def __init__(self):
        super().__init__()
        self.open, self.attributes, self.words = [], [], []

    def handle_starttag(self, tag, attrs):
        self.attributes += attrs
        if tag not in self.VOID:
            self.open.append(tag)

    def handle_startendtag(self, _tag, attrs):
        self.attributes += attrs

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def read(html):
    tags = Tags()
    tags.feed(html)
    assert not tags.open
    return tags


def test_the_page_is_whole_and_needs_nothing_else(results):
    html = page(results, {"spot_move_box-10": b"\xff\xd8 picture"})
    tags = read(html)
    sources = [value for key, value in tags.attributes if key in ("src", "href", "xlink:href")]
    outside = [source for source in sources if not source.startswith("#")]
    assert outside == ["data:image/jpeg;base64,/9ggcGljdHVyZQ=="]
    assert not re.search(r"@import|url\((?!#)", html)
    assert "a computer & its cores" in tags.words
    assert "sumo-dist <x>" in tags.words
    assert any("solved in 14.0 s" in word for word in tags.words)


def cells(html):
    return [
        [re.sub("<.*?>", "", cell) for cell in re.findall(r"<td.*?</td>", row)]
        for row in re.findall(r"<tr>(.*?)</tr>", html)
    ]


def test_the_table_has_the_paper_and_the_control_beside(results):
    _, box, tire, *_ = cells(page(results, {}))
    assert box[:6] == [BOX, "19/20", "0.95", "0.76 to 0.99", "0.85", "-"]
    assert box[8] == "success 19, rolled &lt; away 1"
    assert tire[:6] == [TIRE, "4/20", "0.20", "0.08 to 0.42", "0.95", "1/20"]


def test_a_rate_is_marked_where_chance_does_not_explain_it(results):
    html = page(results, {})
    assert '<td class="number at-least">0.95</td>' in html
    assert '<td class="number below">0.20</td>' in html


def charts(html):
    return [ElementTree.fromstring(svg) for svg in re.findall("<svg.*?</svg>", html, re.DOTALL)]


def words(svg):
    return ["".join(node.itertext()) for node in svg.iter() if node.tag.endswith("}text")]


def test_charts_are_well_formed_and_count_right(results):
    overview, solved_by, endings = charts(page(results, {}))
    for task, solved in ((BOX, 19), (TIRE, 4)):
        (dots,) = [node for node in overview.iter() if node.get("id") == f"times of {task}"]
        assert len([node for node in dots.iter() if node.tag.endswith("}use")]) == solved
    assert {"1 unsolved", "16 unsolved", "move box", "the robot only stands"} <= {*words(overview)}
    assert {"move box  19/20", "upright tire  4/20"} <= {*words(solved_by)}
    assert {"19", "1", "4", "16", "success", "fell", "rolled < away"} <= {*words(endings)}


def test_charts_have_no_colours_of_their_own(results):
    for svg in re.findall("<svg.*?</svg>", page(results, {}), re.DOTALL):
        assert "var(--ink)" in svg
        assert not re.search(r"(?:fill|stroke): ?#", svg)


def test_a_page_without_its_libraries_is_one_clear_error(monkeypatch, results, tmp_path):
    missing = ["jinja2, which is not installed"]
    monkeypatch.setattr("sumo_dist.extras.lacking", lambda _extra: missing)
    with pytest.raises(SumoError, match=r"page of a report needs jinja2.*'sumo-dist\[bench\]'"):
        publish.main(publish.Options(tmp_path))
    assert (tmp_path / "report.md").exists()


def test_a_strip_has_the_times_of_its_pictures():
    assert replay.STRIP == PICTURES


def test_markdown_names_every_failed_trial(results):
    report = text(results)
    assert "| spot/move_box     | 19/20   | 0.95 |" in report
    assert report.count("| spot/upright_tire | ") == 1 + 16
    assert "| rolled < away | 30.00  | 0.06 " in report
    assert f"rollouts {PlannerConfig().rollouts}" in report


def test_motion_is_in_the_report_where_it_was_measured(tmp_path, make_row):
    measured = {"limb_reversals_hz": 17.0, "work_j": 250.0}
    rows = [
        make_row(BOX, 1, 4.0, motion=measured),
        make_row(BOX, 2, 4.0, motion={**measured, "work_j": 350.0}),
        make_row(TIRE, 1, 4.0),
    ]
    (tmp_path / JOURNAL).write_text("".join(json.dumps(row) + "\n" for row in rows))
    request = {"suite": "paper-analysis", "command": "x", "tasks": [BOX, TIRE], "trials": 2}
    (tmp_path / REQUEST).write_text(json.dumps({**request, "seed0": 1}))
    results = Results.load(tmp_path)
    _, section = text(results).split("## Motion")
    lines = [line for line in section.splitlines() if line.startswith("| spot/")]
    assert [cell.strip() for cell in lines[0].split("|")[1:-1]] == [BOX, "17.0", *"-------", "300"]
    assert not any(line.startswith(f"| {TIRE}") for line in lines)
    assert [BOX, "17.0", *"-------", "300"] in cells(page(results, {}))


def test_a_report_without_any_motion_has_no_such_section(results):
    assert "Motion" not in text(results)
    assert "Motion" not in page(results, {})
