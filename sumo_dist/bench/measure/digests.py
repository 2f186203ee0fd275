"""`sumo-dist bench digests`: do lockstep runs still have the bits that they had at known commits.

The runs, their digests and the commits these are of stand in digests.json: whole runs, to their
ends, and short ones with few rollouts, which the test suite repeats. Equal bits need the same kind
of processor and libraries, so the file says which they are of.
"""

import json
import platform
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from sumo_dist.bench.layout import Result, run_bench, table
from sumo_dist.episode.config import EpisodeConfig
from sumo_dist.episode.ending import End
from sumo_dist.episode.single import run_single
from sumo_dist.planner.config import PlannerConfig
from sumo_dist.tasks import load_task
from sumo_dist.terminal import say

EXPECTED = Path(__file__).with_name("digests.json")


@dataclass(frozen=True)
class Options:
    """Options of `bench digests`.

    Attributes:
        json: print one JSON object.
        short: run the short ones only.
    """

    json: bool = False
    short: bool = False


def main(options: Options) -> int:
    """Repeat the runs; 1 if one has other bits, or if these bits are of another kind of machine."""
    result = run_bench("bench digests", options.json, lambda: measure(options), text)
    return 0 if result["comparable"] and all(row["same"] for row in result["rows"]) else 1


def measure(options: Options) -> Result:
    """Run what the file lists, one after the other."""
    known = expected()
    rows = []
    for entry in known["short" if options.short else "full"]:
        rows.append(repeat(entry))
        say(f"{entry['run']}: {'same' if rows[-1]['same'] else 'OTHER BITS'}")
    about = {"bits": bits(), "known_bits": known["bits"]}
    return {**about, "comparable": bits() == known["bits"], "rows": rows}


def expected() -> dict[str, Any]:
    """Return what is known: the kind of bits, whole and short runs with digests."""
    return json.loads(EXPECTED.read_text())


def bits() -> str:
    """Name what equal runs have equal bits on: processor's instructions and numeric libraries."""
    from numpy._core._multiarray_umath import __cpu_features__ as features

    wide = "avx512" if features.get("AVX512_SKX") else "avx2" if features.get("AVX2") else "plain"
    libraries = [f"{name} {version(name)}" for name in ("mujoco", "numpy")]
    return ", ".join([f"{platform.machine()} {wide}", " ".join(platform.libc_ver()), *libraries])


def repeat(entry: Result) -> dict[str, Any]:
    """Run one entry again and compare."""
    given = {"preset": "default", "optimizer": None, "set": (), **entry["planner"]}
    of_task = load_task(entry["episode"]["task"]).planner
    planner = PlannerConfig.resolve(of_task, given["preset"], given["optimizer"], given["set"])
    episode = EpisodeConfig(planner=planner, **entry["episode"])
    recording, ending = run_single(episode, threads=1)
    if ending.kind is End.INTERRUPTED:
        raise KeyboardInterrupt  # half a run says nothing of its bits
    found = {"plan_digest": recording.plan_digest, "state_digest": recording.state_digest}
    same = all(found[key] == entry[key] for key in found)
    about = {
        "run": entry["run"],
        "commit": entry["commit"],
        "ended": ending.reason,
        "plans": len(recording.plan_ticks),
    }
    return {**about, "same": same, **found}


def text(result: Result) -> Iterable[str]:
    """Lay out what was compared."""
    yield f"Lockstep runs in one process, against those of known commits; bits of {result['bits']}."
    if not result["comparable"]:
        yield f"The known digests are of {result['known_bits']}: a difference says nothing here."
    rows = [
        {**row, "p": row["plan_digest"][:12], "s": row["state_digest"][:12]}
        for row in result["rows"]
    ]
    columns = {
        "sumo-dist run": "`{run}`",
        "commit": "{commit}",
        "ended": "{ended}",
        "plans": "{plans}",
        "plan digest": "{p}",
        "state digest": "{s}",
        "same": "{same}",
    }
    yield table(columns, rows)
