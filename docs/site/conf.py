"""How Sphinx makes the site of the pages in the repository: `deploy/site` builds it.

The root of the checkout is Sphinx's source folder, so that the links of a page hold on the site and
in the repository alike; `docs/README.md` is the first page.
"""

from importlib.metadata import version as installed
from pathlib import Path
from typing import Any

project = "sumo-dist"
author = "the authors of sumo-dist"
release = version = installed("sumo-dist")
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.napoleon"]
root_doc = "docs/README"
include_patterns = ["*.md", "docs/**.md"]
exclude_patterns = [".*", "build", "dist", "runs", "sumo_dist", "tests", "policies", "services"]
exclude_patterns += ["assets", "tasks", "deploy", "typings"]

myst_heading_anchors = 4
myst_enable_extensions = ["colon_fence"]

autodoc_member_order = "bysource"
autodoc_typehints = "description"  # a signature of some lines hides the names
autodoc_typehints_description_target = "documented"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
napoleon_google_docstring = True
napoleon_numpy_docstring = False
napoleon_use_ivar = True
add_module_names = False
toc_object_entries = False
default_role = "code"  # what docstrings have in backticks
smartquotes = False

html_theme = "furo"
html_title = "sumo-dist"
html_copy_source = html_show_copyright = html_show_sphinx = False
html_static_path: list[str] = ["static"]
html_css_files = ["site.css"]
html_additional_pages = {"index": "forward.html"}
templates_path = ["templates"]

# The pages have no tables of contents of their own, which would be code in the repository.
CONTENTS: dict[str, tuple[str, ...]] = {
    "Begin": ("docs/start", "docs/concepts", "docs/gallery/README"),
    "Tutorials": (
        "docs/tutorials/new-object",
        "docs/tutorials/new-robot",
        "docs/tutorials/more-machines",
    ),
    "How to": (
        "docs/guides/steer",
        "docs/replay",
        "docs/guides/settings",
        "docs/tuning",
        "docs/guides/learning",
        "docs/guides/keys",
        "docs/jobs",
        "docs/benchmark",
        "docs/library",
    ),
    "Reference": ("docs/reference/commands", "docs/reference/planner", "docs/reference/api"),
    "What was measured": ("docs/results/README",),
    "The project": (
        "docs/decisions/README",
        "CHANGELOG",
        "CONTRIBUTING",
        "SECURITY",
        "README",
    ),
}
ROOT = Path(__file__).parents[2]
LISTED = {page for pages in CONTENTS.values() for page in pages}
OTHERS = tuple(
    page
    for path in sorted([*(ROOT / "docs").glob("*.md"), *(ROOT / "docs" / "guides").glob("*.md")])
    if (page := str(path.relative_to(ROOT).with_suffix(""))) not in {*LISTED, root_doc}
)
CONTENTS["How to"] += OTHERS
BELOW = {"docs/results/README": "docs/results/*", "docs/decisions/README": "docs/decisions/0*"}


def tree(pages: tuple[str, ...], options: str) -> str:
    """Return a hidden table of contents of some pages."""
    entries = "\n".join(f"/{page}" for page in pages)
    return f"\n```{{toctree}}\n{options}\n\n{entries}\n```\n"


def add_contents(_app: Any, page: str, source: list[str]) -> None:
    """Append to a page the table of contents of those below it."""
    if page == root_doc:
        for caption, pages in CONTENTS.items():
            source[0] += tree(pages, f":hidden:\n:caption: {caption}")
    if page in BELOW:
        source[0] += tree((BELOW[page],), ":hidden:\n:glob:")


def setup(app: Any) -> None:
    """Let pages be completed when they are read."""
    app.connect("source-read", add_contents)
