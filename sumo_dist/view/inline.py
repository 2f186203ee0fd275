"""A film or a picture of a recording, which a notebook shows by itself."""

import base64
from dataclasses import dataclass
from pathlib import Path

from sumo_dist.record.recording import Recording
from sumo_dist.view.replay import render

_TYPES = {".mp4": "video/mp4", ".gif": "image/gif", ".webp": "image/webp", ".jpg": "image/jpeg"}


@dataclass(frozen=True)
class Film:
    """A file that `film` has written.

    Attributes:
        path: of the file.
    """

    path: Path

    def _repr_html_(self) -> str:
        """Put the file itself into a notebook, which needs neither a viewer nor the file then."""
        kind = _TYPES[self.path.suffix]
        source = f"data:{kind};base64,{base64.b64encode(self.path.read_bytes()).decode()}"
        if kind.startswith("video"):
            return f'<video src="{source}" controls></video>'
        return f'<img src="{source}"/>'


def film(recording: Recording, path: str | Path) -> Film:
    """Write a film of a recording, drawn by MuJoCo without a display.

    Args:
        recording: what to draw.
        path: .mp4, .gif, .webp, or .jpg for a strip of a few pictures from start to end.

    Returns:
        The file, which a notebook shows where it is a cell's last line.

    Raises:
        UsageError: another ending.
        SumoError: no graphics library works here, the film cannot be written, or the `film` extra
            is not installed.
    """
    render(recording, Path(path))
    return Film(Path(path))
