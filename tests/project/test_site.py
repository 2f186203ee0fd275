"""The site: it is built without a warning, its links hold, and it asks nothing of other hosts."""

import json
import re
import runpy
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote, urldefrag

import pytest

import sumo_dist
from sumo_dist.cli import COMMANDS, main
from sumo_dist.extras import lacking

ROOT = Path(__file__).parents[2]
SITE = ROOT / "docs" / "site"
NEEDS = pytest.mark.skipif(
    bool(lacking("docs")), reason=f"the site needs {', '.join(lacking('docs'))}"
)
ELSEWHERE = re.compile(r"^(?:https?:)?//")


def build(source: Path, into: Path) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-P", "-m", "sphinx", "-q", "-W", "--keep-going", "-c", str(SITE)]
    return subprocess.run(
        [*command, "-d", str(into / "doctrees"), "-b", "html", str(source), str(into / "site")],
        capture_output=True, text=True, check=False, timeout=170,
    )  # fmt: skip


@pytest.fixture(scope="module")
def site(tmp_path_factory) -> Path:
    """The folder of the built site."""
    into = tmp_path_factory.mktemp("site")
    done = build(ROOT, into)
    assert (done.returncode, done.stderr) == (0, "")
    return into / "site"


def addresses(page: Path, attributes: str) -> list[str]:
    return re.findall(rf'\b(?:{attributes})="([^"]+)"', page.read_text("utf-8"))


@NEEDS
@pytest.mark.slow
def test_what_a_page_links_to_is_on_the_site(site):
    """Anchors, too, also of what Sphinx makes of docstrings."""
    anchors = {page: set(addresses(page, "id|name")) for page in site.rglob("*.html")}
    assert len(anchors) > 70
    dead = []
    for page in anchors:
        for address in addresses(page, "href|src"):
            if re.match(r"[a-z]+:", address):
                continue
            path, anchor = map(unquote, urldefrag(re.sub(r"\?v=\w+", "", address)))
            target = (page.parent / path).resolve() if path else page
            if not target.is_file() or (
                anchor and target in anchors and anchor not in anchors[target]
            ):
                dead.append(f"{page.relative_to(site)}: {address}")
    assert dead == []


@NEEDS
@pytest.mark.slow
def test_the_site_needs_no_other_host(site):
    asked = [
        f"{page.name}: {found}"
        for page in site.rglob("*.html")
        for found in re.findall(r"<(?:script|img|iframe|link)\b[^>]*", page.read_text("utf-8"))
        if any(map(ELSEWHERE.match, re.findall(r'(?:src|href)="([^"]+)"', found)))
    ]
    styles = [
        f"{path.name}: {found}"
        for path in (*site.rglob("*.css"), *site.rglob("*.svg"))
        for found in re.findall(
            r"""(?:url\(|@import\s)\s*["']?([^"')]+)""", path.read_text("utf-8")
        )
        if ELSEWHERE.match(found)
    ]
    assert asked + styles == []


@NEEDS
@pytest.mark.slow
def test_the_first_page_leads_to_all_others(site):
    first = (site / "index.html").read_text("utf-8")
    (start,) = set(re.findall(r"docs/README\.html", first))
    listed = addresses(site / start, "href")
    for page in ("start", "concepts", "gallery/README", "guides/steer", "reference/api"):
        assert f"{page}.html" in listed
    assert "../SECURITY.html" in listed


@NEEDS
@pytest.mark.slow
def test_dead_links_and_anchors_fail(tmp_path):
    """With the configuration that the site has, on two pages of our own."""
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "README.md").write_text(
        "# One\n\n[gone](gone.md) [nowhere](other.md#nowhere) ![no](picture.png)\n"
        "[fine](other.md#here)\n"
    )
    (tmp_path / "docs" / "other.md").write_text("# Other\n\n## Here\n")
    done = build(tmp_path, tmp_path / "built")
    assert done.returncode != 0
    for dead in ("gone.md", "nowhere", "picture.png"):
        assert re.search(rf"WARNING: .*{re.escape(dead)}", done.stderr), done.stderr
    assert "#here" not in done.stderr and "'here'" not in done.stderr


@NEEDS
@pytest.mark.parametrize("name", ["commands", "planner"])
def test_reference_pages_are_those_of_the_code(name):
    """`deploy/site` writes them."""
    made = runpy.run_path(str(SITE / "reference.py"))[name]()
    assert (ROOT / "docs" / "reference" / f"{name}.md").read_text("utf-8") == made


@pytest.mark.parametrize("command", ["run", "ctl", "optimizer", "bench suite", "keys host"])
def test_the_reference_has_what_help_has(command, capsys):
    assert main([*command.split(), "--help"]) == 0
    shown = capsys.readouterr().out
    offered = set(re.findall(r"^[│ ] (--[a-z][\w.-]*)", shown, re.MULTILINE)) - {"--help"}
    page = (ROOT / "docs" / "reference" / "commands.md").read_text("utf-8")
    section = re.search(
        rf"^## sumo-dist {command}\n(.*?)(?=^## |\Z)", page, re.DOTALL | re.MULTILINE
    )
    assert section is not None
    listed = set(re.findall(r"^\| `(--[\w.-]+)", section[1], re.MULTILINE))
    assert offered == listed != set()
    assert len(re.findall(r"^## sumo-dist ", page, re.MULTILINE)) == len(COMMANDS)


def test_the_reference_has_every_name_for_scripts():
    page = (ROOT / "docs" / "reference" / "api.md").read_text("utf-8")
    assert set(re.findall(r":: sumo_dist\.(\w+)$", page, re.MULTILINE)) == set(sumo_dist._NAMES)


def test_the_index_of_results_names_every_page_and_its_commits():
    index = ROOT / "docs" / "results" / "README.md"
    rows = [line for line in index.read_text("utf-8").splitlines() if line.startswith("| [")]
    named = {name for row in rows for name in re.findall(r"\]\((\w[\w-]*\.(?:md|html))\)", row)}
    there = {path.name for path in index.parent.iterdir() if path.suffix in (".md", ".html")}
    assert named == there - {"README.md"}
    for row in rows:
        _, pages, _, commits, defaults, _ = (cell.strip() for cell in row.split("|"))
        first = (index.parent / re.findall(r"\(([\w-]+\.md)\)", pages)[0]).read_text("utf-8")
        for commit in re.findall(r"\b[0-9a-f]{7}\b", commits):
            assert commit in first, row
        assert defaults in ("today's", "former", "-", "both, by row"), row


def test_the_citation_has_what_its_format_requires():
    yaml = pytest.importorskip("yaml")
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert citation["cff-version"] == "1.2.0"
    required = {"message", "title", "authors", "version", "license", "preferred-citation"}
    assert required <= citation.keys()
    assert citation["version"] == sumo_dist.__version__
    for work in (citation, citation["preferred-citation"]):
        assert all({"name", "family-names"} & author.keys() for author in work["authors"])
    assert {"type", "title", "authors"} <= citation["preferred-citation"].keys()


def test_issue_forms_are_what_the_host_takes():
    yaml = pytest.importorskip("yaml")
    folder = ROOT / ".github" / "ISSUE_TEMPLATE"
    forms = {p.stem: yaml.safe_load(p.read_text("utf-8")) for p in folder.glob("*.yml")}
    assert forms.pop("config") == {"blank_issues_enabled": False}
    assert set(forms) == {"bug", "idea", "task"}
    for form in forms.values():
        assert {"name", "description", "body"} <= form.keys()
        ids = [part["id"] for part in form["body"] if part["type"] != "markdown"]
        assert len(ids) == len(set(ids)) > 0
        for part in form["body"]:
            assert part["type"] in ("markdown", "textarea", "input", "dropdown", "checkboxes")
            assert "value" in part["attributes"] or part["attributes"]["label"]
        links = re.findall(r"\]\(\.\./blob/HEAD/([^)]+)\)", json.dumps(form))
        assert "SECURITY.md" in links
        assert [link for link in links if not (ROOT / link).exists()] == []
