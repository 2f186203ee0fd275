"""Takes pictures of the view's layouts: python docs/images/layouts.py RUN/run.rrd --at 5.

Writes layout-drive.webp, layout-tune.webp and layout-fleet.webp, or DIR/layout-drive-1180x820.webp
and so on for another size. The run must be one by services, such as of

    sumo-dist run spot/move_box --clock realtime --viewer none --rrd --out RUN

Needs a graphics library that works without a display (Debian: mesa-vulkan-drivers).
"""

import io
import os
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, TypeVar

import rerun_cli
import tyro
from PIL import Image
from rerun.experimental import ViewerClient

from sumo_dist.terminal import say
from sumo_dist.view.viewers import free_port

T = TypeVar("T")

LAYOUTS = ("drive", "tune", "fleet")
USUAL = (1920, 1080)
SMALLER = 0.75  # of a usual picture as it is kept
LOADS_S = 60.0
DRAWS_S = 2.0


@dataclass(frozen=True)
class Options:
    """What to take pictures of.

    Attributes:
        rrd: a run's file.
        at: moment of the run [s].
        size: of the window [pixels].
        out: folder for the pictures.
    """

    rrd: Annotated[Path, tyro.conf.Positional]
    at: float = 5.0
    size: tuple[int, int] = USUAL
    out: Path = Path(__file__).parent


def main(options: Options) -> None:
    """Take a picture of each layout."""
    with _viewer(options.size) as viewer:
        viewer.open(str(options.rrd.absolute()))
        _wait_for(lambda: viewer.get_state().views or None)
        for name in LAYOUTS:
            _turn_to(viewer, name)
            viewer.set_time("sim_time", duration=options.at, play_state="paused")
            time.sleep(DRAWS_S)
            _keep(Image.open(io.BytesIO(viewer.take_screenshot())), name, options)


def _keep(picture: Image.Image, name: str, options: Options) -> None:
    suffix = ""
    if options.size == USUAL:
        picture = picture.resize([round(side * SMALLER) for side in USUAL])
    else:
        suffix = "-{}x{}".format(*options.size)
    path = options.out / f"layout-{name}{suffix}.webp"
    picture.convert("RGB").save(path, quality=75, method=6)
    say(f"{path}: {path.stat().st_size / 1e3:.0f} kB")


def _turn_to(viewer: ViewerClient, name: str) -> None:
    """Open the tab of a layout."""
    blueprint = viewer.get_blueprint().blueprint
    parts = {path: part.get("ContainerBlueprint", {}) for path, part in blueprint.items()}
    tab = next(path for path, part in parts.items() if part.get("display_name") == name)
    tabs = next(part for part in parts.values() if part.get("container_kind") == "Tabs")
    tabs["active_tab"] = tab.lstrip("/")
    viewer.set_blueprint(blueprint, of="recording")


@contextmanager
def _viewer(size: tuple[int, int]) -> Iterator[ViewerClient]:
    port = free_port(0)
    binary = Path(rerun_cli.__file__).with_name("rerun")
    window = ("--headless", "--window-size", "{}x{}".format(*size), "--hide-welcome-screen")
    process = subprocess.Popen(
        [binary, *window, "--bind", "127.0.0.1", "--port", str(port)],
        env={**os.environ, "CI": "true"},  # on a build machine it sends no statistics
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield _wait_for(lambda: _client(port))
    finally:
        process.terminate()
        process.wait()


def _client(port: int) -> ViewerClient | None:
    try:
        return ViewerClient(f"rerun+http://127.0.0.1:{port}/proxy")
    except Exception:  # of several kinds, until it is up
        return None


def _wait_for(probe: Callable[[], T | None]) -> T:
    until = time.monotonic() + LOADS_S
    while not (found := probe()):
        if time.monotonic() > until:
            raise SystemExit("Rerun's viewer does not come up, or does not load the file")
        time.sleep(0.2)
    return found


if __name__ == "__main__":
    main(tyro.cli(Options))
