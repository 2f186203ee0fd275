"""`sumo-dist doctor`: what works on this machine, and what to do about what does not."""

import importlib
import importlib.metadata
import json
import os
import platform
import queue
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from sumo_dist.check.findings import Finding, examine
from sumo_dist.errors import SumoError, unknown
from sumo_dist.extras import lacking, required

# Checks import what they check: a broken package then fails its line and not the command.

PYTHONS = ((3, 11), (3, 13))
PINGS = 50
PLANS = 12
LEAST_GB = 1.0
CPU_QUOTA = Path("/sys/fs/cgroup/cpu.max")
RENDER = (
    "import mujoco; mujoco.Renderer(mujoco.MjModel.from_xml_string('<mujoco/>'), 8, 8).render()"
)


@dataclass(frozen=True)
class Options:
    """Options of `doctor`.

    Attributes:
        only: these checks; by default all.
        json: print one JSON object, {check: [level, text]}, when all are done.
        hosts: a hosts file: look at its hosts, and whether together they can carry a run.
    """

    only: tuple[str, ...] = ()
    json: bool = False
    hosts: Path | None = None


def main(options: Options) -> int:
    """Print a line per check; 0 if none failed, else 3."""
    if options.hosts is not None:
        return _of_hosts(options.hosts)
    for name in options.only:
        if name not in CHECKS:
            raise unknown("check", name, CHECKS)
    found = {}
    for name in options.only or CHECKS:
        found[name] = finding = examine(CHECKS[name])
        if not options.json:
            print(f"{finding.level:<6}{name:<12}{finding.text}", flush=True)
    if options.json:
        print(json.dumps({name: [f.level, f.text] for name, f in found.items()}))
    return _exit_code(found.values())


def _of_hosts(path: Path) -> int:
    """Print a line for each host and finding."""
    from sumo_dist.hosts.examine import examined
    from sumo_dist.hosts.inventory import read_inventory

    found = []
    for host, subject, finding in examined(read_inventory(path)):
        found.append(finding)
        print(f"{finding.level:<6}{host:<12}{subject:<12}{finding.text}", flush=True)
    return _exit_code(found)


def _exit_code(findings: Iterable[Finding]) -> int:
    return SumoError.exit_code if any(f.level == "fail" for f in findings) else 0


def python() -> Finding:
    """Is the interpreter one of those that are tested."""
    low, high = (".".join(map(str, version)) for version in PYTHONS)
    text = f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    if PYTHONS[0] <= sys.version_info[:2] <= PYTHONS[1]:
        return Finding("ok", text)
    return Finding("fail", f"{text}: needs {low} to {high}")


def packages() -> Finding:
    """Are the packages in the ranges that this release is tested with."""
    found, wrong = [], lacking("")
    for name, _ in required():
        importlib.import_module({"eclipse-zenoh": "zenoh"}.get(name, name))
        found.append(f"{name} {importlib.metadata.version(name)}")
    if wrong:
        return Finding("fail", f"needs {'; '.join(wrong)}: install sumo-dist again")
    return Finding("ok", ", ".join(found))


def engine() -> Finding:
    """Is there the native engine, and why not."""
    from sumo_dist.rollout import engine_identity

    if find_spec("sumo_dist.rollout._native") is None:
        name, _ = engine_identity("fallback")
        text = f"{name}, about half as fast: this installation was built without a C++ compiler"
        return Finding("warn", f"{text}; get one and install again")
    name, build = engine_identity("native")
    if name == "native-portable":
        return Finding("warn", f"{name}, build {build}: slow, for this processor has no AVX2")
    return Finding("ok", f"{name}, build {build}")


def policies() -> Finding:
    """Are the weights in the cache, and are they the pinned ones."""
    from sumo_dist.policies.fetch import cache_dir, cached
    from sumo_dist.policies.manifest import read_manifest

    pinned = read_manifest().values()
    missing = [policy.name for policy in pinned if not (cache_dir() / policy.file_name).exists()]
    for policy in pinned:
        if policy.name not in missing:
            cached(policy)
    if missing:
        return Finding("warn", f"{', '.join(missing)}: not in {cache_dir()}, fetched on first need")
    return Finding("ok", f"{', '.join(p.name for p in pinned)}: in {cache_dir()}, hashes right")


def zenoh() -> Finding:
    """Do two services reach each other through a router on this machine."""
    import numpy as np

    from sumo_dist.launch.launcher import listening
    from sumo_dist.wire.bus import Bus
    from sumo_dist.wire.messages import EpisodeEnd, State
    from sumo_dist.wire.session import open_router

    endpoint, run = listening("tcp/127.0.0.1:0"), "doctor"
    with (
        open_router(endpoint),
        Bus.dial(endpoint, "doctor", run=run) as here,
        Bus.dial(endpoint, "doctor", run=run) as there,
    ):
        answers = here.inbox(EpisodeEnd)
        there.subscribe(
            State, lambda s: there.publish(EpisodeEnd(run, s.tick, "pong", success=True, last=True))
        )
        took = []
        for tick in range(PINGS):
            began = time.perf_counter()
            here.publish(State(run, tick, np.zeros(64)))
            try:
                while answers.get(timeout=1.0).tick != tick:
                    pass
            except queue.Empty:
                if tick > 2:  # the first may be sent before the subscription has spread
                    return Finding("fail", f"no answer in 1 s through a router on {endpoint}")
            took.append(time.perf_counter() - began)
    return Finding("ok", f"round trip {statistics.median(took) * 1e3:.2f} ms through a router")


def keys() -> Finding:
    """Is there an authority here, its keys private, and all that it has issued good for a while."""
    from sumo_dist.authority.folder import SOON_DAYS
    from sumo_dist.authority.store import Authority, home_of

    home = home_of(None)
    if not (home / "authority").exists():
        return Finding("ok", f"no authority in {home}: only what leaves this machine needs keys")
    authority = Authority(home)
    if exposed := authority.exposed():
        paths = " ".join(map(str, exposed))
        return Finding("warn", f"others may read or change {paths}: chmod 600")
    newest = {(one.host, one.role): one for one in authority.issued() if not one.revoked}
    ends = {
        f"{host}'s {role}": datetime.fromisoformat(one.expires)
        for (host, role), one in newest.items()
    }
    ends["the authority"] = authority.ca.expires
    now = datetime.now(UTC)
    first = min(ends, key=lambda name: ends[name])
    text = f"{len(newest)} certificates of {home}: {first} ends first, on {ends[first]:%Y-%m-%d}"
    if ends[first] > now + timedelta(days=SOON_DAYS):
        return Finding("ok", text)
    over = ", ".join(sorted(name for name, end in ends.items() if end <= now))
    hint = "`sumo-dist keys renew HOST`"
    if over:
        return Finding("warn", f"expired: {over}; {hint}, or `revoke` what is not used")
    return Finding("warn", f"{text}: {hint}")


def rerun() -> Finding:
    """Is the viewer installed."""
    if reasons := lacking("view"):
        text = f"no viewer, no .rrd: needs {', '.join(reasons)}: pip install 'sumo-dist[view]'"
        return Finding("warn", text)
    importlib.import_module("rerun")
    return Finding("ok", f"rerun-sdk {importlib.metadata.version('rerun-sdk')}")


def films() -> Finding:
    """Is there what writes films."""
    if reasons := lacking("film"):
        return Finding(
            "warn", f"no films: need {', '.join(reasons)}: pip install 'sumo-dist[film]'"
        )
    return Finding("ok", f"imageio-ffmpeg {importlib.metadata.version('imageio-ffmpeg')}")


def rendering() -> Finding:
    """Can MuJoCo draw without a screen, as films of a run need it."""
    backend = os.environ.get("MUJOCO_GL", "")
    if renders(backend):
        return Finding("ok", f"MuJoCo draws with {backend or 'its default backend'}")
    working = [other for other in ("egl", "osmesa") if other != backend and renders(other)]
    if working:
        return Finding("warn", f"films need `export MUJOCO_GL={working[0]}` on this machine")
    return Finding("warn", "MuJoCo cannot draw here, so no films: install libegl1 or libosmesa6")


def renders(backend: str) -> bool:
    """Try a rendering backend in a process of its own: a failing one may end it."""
    environment = {**os.environ, "MUJOCO_GL": backend}
    command = (sys.executable, "-P", "-c", RENDER)
    try:
        done = subprocess.run(
            command, env=environment, capture_output=True, timeout=60, check=False
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def cores() -> Finding:
    """How many cores there are, and who else uses them."""
    from sumo_dist.provenance import cores as count
    from sumo_dist.provenance import machine
    from sumo_dist.rollout import engine_identity

    hints = []
    if (quota := cpu_quota()) is not None and quota < count():
        hints.append(f"the container may use only {quota:g} of them: set --workers accordingly")
    if hasattr(os, "getloadavg") and (load := os.getloadavg()[0]) > 0.5 * count():
        hints.append(f"busy (load {load:.1f}): what is timed below is slower than it could be")
    if engine_identity()[0] == "fallback" and os.environ.get("OPENBLAS_NUM_THREADS") != "1":
        hints.append("workers' BLAS threads compete: export OPENBLAS_NUM_THREADS=1")
    return Finding("warn" if hints else "ok", "; ".join([machine(), *hints]))


def cpu_quota() -> float | None:
    """Cores that a container's quota allows, None without a quota."""
    try:
        quota, period = CPU_QUOTA.read_text(encoding="ascii").split()
        return int(quota) / int(period)
    except (OSError, ValueError):  # "max", or no such file
        return None


def priority() -> Finding:
    """Do robot, estimator, optimizer and router go before everything else on the machine."""
    from sumo_dist.priority import VARIABLE, going_first

    with going_first() as permitted:
        pass
    if permitted:
        return Finding("ok", "the robot's services run with real-time priority")
    if os.environ.get(VARIABLE) == "normal":
        return Finding("warn", f"normal, as {VARIABLE} says: commands may be late in realtime")
    hint = "let the user have rtprio 10 (Linux: /etc/security/limits.conf)"
    return Finding("warn", f"no real-time priority: commands may be late; {hint}")


def disk() -> Finding:
    """Is there room for recordings here."""
    free = shutil.disk_usage(".").free / 1e9
    if free < LEAST_GB:
        return Finding("warn", f"{free:.1f} GB free here: a run with viewer takes 0.1 GB a minute")
    return Finding("ok", f"{free:.0f} GB free here")


def planning() -> Finding:
    """How long a plan takes in one process with all cores, and what that allows in realtime."""
    from sumo_dist.bench.measure.realtime import at_least
    from sumo_dist.planner.config import PlannerConfig
    from sumo_dist.policies.fetch import cache_dir
    from sumo_dist.policies.manifest import pinned_policy
    from sumo_dist.provenance import cores as count
    from sumo_dist.timing import PLAN_PERIOD

    if not (cache_dir() / pinned_policy("spot").file_name).exists():
        return Finding("warn", "not timed: the policy is not in the cache yet")
    wall_ms, cpu_ms = plan_times(count())
    factor = min(1.0, PLAN_PERIOD * 1e3 / wall_ms)
    text = (
        f"{PlannerConfig().rollouts} rollouts: a plan takes about {wall_ms:.0f} ms on {count()} "
        f"cores ({PlannerConfig().rollouts / wall_ms * 1e3:.0f} rollouts/s), realtime factor "
        f"{factor:.2f}"
    )
    if factor == 1.0:
        return Finding("ok", text)
    return Finding("warn", f"{text}; 20 Hz needs at least {at_least(cpu_ms)} such cores, idle")


def plan_times(threads: int) -> tuple[float, float]:
    """Wall and processor time of a plan of default settings, medians of some [ms]."""
    from sumo_dist.bench.measure.planning import in_process, request
    from sumo_dist.bench.measure.snapshot import Snapshot
    from sumo_dist.bench.measure.variant import timed
    from sumo_dist.episode.assemble import Episode
    from sumo_dist.episode.config import EpisodeConfig

    snapshot = Snapshot.load()
    episode = Episode.assemble(EpisodeConfig(snapshot.task))
    with in_process(episode, threads) as plan:
        asked = (request(episode, snapshot, number) for number in range(1, PLANS + 1))
        times = [timed(partial(plan, one))[:2] for one in asked]
    wall, cpu = zip(*times, strict=True)
    return statistics.median(wall), statistics.median(cpu)


CHECKS: dict[str, Callable[[], Finding]] = {
    "python": python,
    "packages": packages,
    "engine": engine,
    "policies": policies,
    "zenoh": zenoh,
    "keys": keys,
    "rerun": rerun,
    "films": films,
    "rendering": rendering,
    "cores": cores,
    "priority": priority,
    "disk": disk,
    "planning": planning,
}
