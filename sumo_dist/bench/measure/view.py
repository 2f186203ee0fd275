"""`sumo-dist bench view`: what being watched costs a plan, and how soon there is something to see.

One run is made with nobody who watches, with the recorder, and with the operator's page, its 3D
view and the recorder, in turn. A client takes the page's pictures all the while.
"""

import asyncio
import re
import shutil
import subprocess
import threading
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from sumo_dist.bench.layout import Result, check_at_least, run_bench, table
from sumo_dist.bench.measure.runs import SAID, RunOptions
from sumo_dist.episode.summary import read_summary
from sumo_dist.errors import SumoError
from sumo_dist.extras import need
from sumo_dist.terminal import say

START_S = 120.0  # for the services to come up
SLOWEST = 50.0  # times real time that a run may take
WAYS: dict[str, dict[str, object]] = {
    "nobody": {"viewer": "none"},
    "recorder": {"viewer": "none", "rrd": True},
    "page, 3D and recorder": {"viewer": "web"},
}
COLOURED, GREY = 1500, 60  # pixels that say that there is a scene; what differs less is grey
BROWSERS = ("chromium", "chromium-browser", "google-chrome")
COLUMNS = {
    "who watches": "{way}",
    "p50 [ms]": "{plan_ms_p50:.1f}",
    "p99 [ms]": "{plan_ms_p99:.1f}",
    "p50 over nobody's": "{ratio_p50:.3f} ({ratio_p50_range[0]:.3f} to {ratio_p50_range[1]:.3f})",
    "p99 over nobody's": "{ratio_p99:.3f} ({ratio_p99_range[0]:.3f} to {ratio_p99_range[1]:.3f})",
    "plans": "{plans}",
    "missed": "{missed}",
}


@dataclass(frozen=True)
class Options(RunOptions):
    """Options of `bench view`; see also RunOptions.

    Attributes:
        clock: lockstep, or realtime at --speed.
        speed: of the realtime clock.
        pictures: openings of the page in a browser; 0 leaves that out.
    """

    clock: str = "lockstep"
    speed: float = 0.5
    pictures: int = 3

    def __post_init__(self) -> None:
        super().__post_init__()
        check_at_least(0, pictures=self.pictures)

    def watched(self, seed: int, out: str, way: Mapping[str, object]) -> list[str]:
        """Return the words that make a run that is watched in some way."""
        speed = {"speed": self.speed} if self.clock == "realtime" else {}
        return self.command(seed, out, clock=self.clock, **speed, **way)


def main(options: Options) -> int:
    """Run all kinds in turn, and print a table or one JSON object."""
    run_bench("bench view", options.json, lambda: measure(options), text)
    return 0


def measure(options: Options) -> Result:
    """Run every seed in each way, then open the page some times."""
    need("view", "bench view")
    about = options.about()
    summaries: dict[str, list[dict[str, Any]]] = {way: [] for way in WAYS}
    for seed in options.seeds:
        for way in WAYS if seed % 2 else reversed(WAYS):
            summaries[way].append(summary := _run(options, seed, way))
            say(f"seed {seed}, {way}: p50 {summary['plan_ms_p50']:.1f} ms")
    rows = [row(way, found, summaries["nobody"]) for way, found in summaries.items()]
    opened = [_opened(options) for _ in range(options.pictures)]
    return {
        **about,
        "workers": options.processes,
        "clock": options.clock,
        "speed": options.speed if options.clock == "realtime" else None,
        "rows": rows,
        "pictures": opened,
    }


def _run(options: Options, seed: int, way: str) -> dict[str, Any]:
    """Make one run in processes of its own and return its summary."""
    with TemporaryDirectory() as folder:
        with Launched(options.watched(seed, folder, WAYS[way])) as run:
            if WAYS[way]["viewer"] == "web":
                threading.Thread(target=_watch, args=(run,), daemon=True).start()
            code = run.wait(START_S + SLOWEST * options.seconds)
        if code is None:
            raise SumoError(f"the run with seed {seed} hung: {run.said[-SAID:]}")
        if code not in (0, 1):
            raise SumoError(f"the run with seed {seed} failed: {run.said[-SAID:]}")
        return read_summary(Path(folder))


class Launched:
    """A run in a process of its own; a context manager that ends it."""

    def __init__(self, command: Sequence[str]) -> None:
        """Start it."""
        self.said = ""
        self.address: str | None = None  # of the page, once it was told
        self._process = subprocess.Popen(
            command, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._process.stderr is not None, "it was asked for"
        for line in self._process.stderr:
            self.said += line.decode(errors="replace")
            if found := re.search(r"run at (http\S+)", self.said):
                self.address = found[1]

    def wait_for_page(self) -> str:
        """Return the page's address, once it is there."""
        deadline = time.monotonic() + START_S
        while self.address is None:
            if self._process.poll() is not None or time.monotonic() > deadline:
                raise SumoError(f"the run has no page: {self.said[-SAID:]}")
            time.sleep(0.01)
        return self.address

    def wait(self, timeout: float) -> int | None:
        """Return the exit code; None if it has not ended in a time [s]."""
        with suppress(subprocess.TimeoutExpired):
            return self._process.wait(timeout)
        return None

    def __enter__(self) -> "Launched":
        return self

    def __exit__(self, *_: object) -> None:
        self._process.terminate()
        self._process.wait()
        self._reader.join()


def _watch(run: Launched) -> None:
    """Take the pictures of a page until the run ends, as a browser does."""
    from aiohttp import ClientError, ClientSession

    async def watch() -> None:
        async with ClientSession() as session, session.ws_connect(f"{address}live") as socket:
            async for _ in socket:
                pass

    address = run.wait_for_page()
    with suppress(ClientError, OSError):
        asyncio.run(watch())


def _opened(options: Options) -> dict[str, float]:
    """Start a run and open its page in a new browser; return when what was seen [s].

    The browser runs before the run is started, as that of somebody who works with it does.
    """
    binary = next(filter(None, map(shutil.which, BROWSERS)), None)
    if binary is None:
        raise SumoError(f"no browser is here: one of {', '.join(BROWSERS)}, or --pictures 0")
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        raise SumoError("opening a browser needs playwright: pip install playwright") from None
    flags = ["--no-sandbox", "--ignore-gpu-blocklist", "--enable-unsafe-swiftshader"]
    with TemporaryDirectory() as folder, sync_playwright() as playwright:
        chromium = playwright.chromium.launch(
            executable_path=binary, args=[*flags, "--use-angle=gl-egl"]
        )
        tab = chromium.new_page(viewport={"width": 1600, "height": 900})
        tab.set_default_timeout(START_S * 1e3)
        began = time.monotonic()
        page = options.watched(1, folder, {"viewer": "web", "stay": True})
        with Launched(page) as run:
            address = run.wait_for_page()
            seen = {"address_s": time.monotonic() - began}
            tab.goto(address)
            while not tab.evaluate("document.querySelector('#costs .bar b:not(:empty)') !== null"):
                tab.wait_for_timeout(20)
            seen["floor_plan_s"] = time.monotonic() - began
            _await_scene(tab)
            seen["scene_s"] = time.monotonic() - began
        chromium.close()
    say(", ".join(f"{name} {value:.1f}" for name, value in seen.items()))
    return seen


def _await_scene(tab: Any) -> None:
    """Wait until Rerun draws the world: its own page has next to no colours."""
    canvas = tab.frame_locator("iframe").locator("canvas")
    canvas.wait_for()
    deadline = time.monotonic() + START_S
    while time.monotonic() < deadline:
        if _coloured(canvas.screenshot()) > COLOURED:
            return
        tab.wait_for_timeout(100)
    raise SumoError("Rerun's view stays empty")


def _coloured(png: bytes) -> int:
    """Count the pixels of a picture that are not grey."""
    from PIL import Image

    pixels = np.asarray(Image.open(BytesIO(png)).convert("RGB"), np.int16)
    return int((np.ptp(pixels, axis=-1) > GREY).sum())


def row(
    way: str, summaries: Sequence[dict[str, Any]], alone: Sequence[dict[str, Any]]
) -> dict[str, Any]:
    """Return medians over the runs of a way, and over nobody's of the same seeds with their range.

    Args:
        way: of watching.
        summaries: of its runs.
        alone: of the runs that nobody watched.
    """
    found: dict[str, Any] = {"way": way}
    for percent in ("p50", "p99"):
        key = f"plan_ms_{percent}"
        own, others = (np.array([s[key] for s in runs], float) for runs in (summaries, alone))
        found[key] = round(float(np.median(own)), 2)
        found[f"ratio_{percent}"] = round(float(np.median(own / others)), 4)
        found[f"ratio_{percent}_range"] = [
            round(float(end(own / others)), 4) for end in (np.min, np.max)
        ]
    return {
        **found,
        "plans": sum(s["plans"] for s in summaries),
        "missed": sum(s["missed_deadlines"] or 0 for s in summaries),
    }


def text(result: Result) -> Iterable[str]:
    """Lay out what was measured."""
    last = result["seed0"] + result["trials"] - 1
    pace = "in lockstep" if result["speed"] is None else f"at {result['speed']} of the wall clock"
    yield (
        f"{result['task']}, seeds {result['seed0']} to {last}, {pace}, {result['workers']} workers "
        f"of one thread, {result['engine']}. Wall time of plans, medians over runs; ratios to the "
        "run of the same seed that nobody watches, their median and range."
    )
    yield table(COLUMNS, result["rows"])
    if result["pictures"]:
        names = {
            "address_s": "address told",
            "floor_plan_s": "floor plan and costs",
            "scene_s": "3D scene",
        }
        shown = [
            {"what": name, **dict(zip("abc", np.percentile(times, (50, 0, 100)), strict=True))}
            for key, name in names.items()
            for times in [[picture[key] for picture in result["pictures"]]]
        ]
        yield (
            f"From the start of `run` to what is seen in a browser that is open, "
            f"{len(result['pictures'])} times [s]:"
        )
        yield table({"seen": "{what}", "median": "{a:.1f}", "range": "{b:.1f} to {c:.1f}"}, shown)
