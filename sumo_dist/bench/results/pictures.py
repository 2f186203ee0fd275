"""What the pictures of pages in the repository share. Needs Matplotlib, of some extras."""

import io
from typing import Any

from matplotlib.figure import Figure

COLOURS = ("#2f6fb3", "#c4622d", "#3a8f5c", "#8a5fb0", "#a08a2c")
STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",  # text stays text
    "svg.hashsalt": "sumo-dist",  # equal results make equal files
    "font.size": 9,
    "axes.titlesize": 9,
    "axes.titlelocation": "left",
    "axes.grid": True,
    "grid.color": "#dddddd",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
}


def svg(figure: Figure) -> str:
    """Return a figure as the text of a file."""
    file = io.StringIO()
    figure.savefig(file, format="svg", metadata={"Date": None})
    return file.getvalue()
