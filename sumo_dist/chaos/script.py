"""Fault scripts: what goes wrong in a run, when, and for how long. TOML files."""

import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from sumo_dist.errors import UsageError, unknown
from sumo_dist.wire.mangle import RULES, Rule

PROCESS_FAULTS = ("kill", "freeze")


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong, once or again and again.

    Attributes:
        kind: "kill" (SIGKILL; the service is started again), "freeze" (SIGSTOP, then SIGCONT), or a
            rule of the mangler.
        target: the service it happens to; of the mangler's rules, all that are behind it.
        after_plan: plan after which it begins.
        lasts: wall time until it is over [s].
        every: plans until it begins again.
        times: how often it happens.
        share, topics, delay_ms, jitter_ms: of a rule, see wire.mangle.
    """

    kind: str
    after_plan: int
    target: str = ""
    lasts: float = 0.5
    every: int = 20
    times: int = 1
    share: float = 1.0
    topics: tuple[str, ...] = ()
    delay_ms: float = 0.0
    jitter_ms: float = 0.0

    def __post_init__(self) -> None:
        if self.kind not in (*PROCESS_FAULTS, *RULES):
            raise unknown("fault", self.kind, (*PROCESS_FAULTS, *RULES))
        if self.is_process and not self.target:
            raise UsageError(f"fault {self.kind!r} needs a target")
        if not 0 <= self.lasts <= 60:
            raise UsageError(f"fault {self.kind!r}: lasts must be from 0 to 60 s, got {self.lasts}")
        if self.times < 1 or self.every < 1 or self.after_plan < 0:
            raise UsageError(f"fault {self.kind!r}: times and every must be at least 1")

    @property
    def is_process(self) -> bool:
        """Whether it happens to a process; else it happens to messages."""
        return self.kind in PROCESS_FAULTS

    @property
    def rule(self) -> Rule:
        """What the mangler does."""
        return Rule(self.kind, self.share, self.topics, self.delay_ms, self.jitter_ms)

    @property
    def plans(self) -> list[int]:
        """Plans after which it happens."""
        return [self.after_plan + i * self.every for i in range(self.times)]


@dataclass(frozen=True)
class Script:
    """A run and its faults.

    Attributes:
        faults: in any order.
        name: of the file.
        task: its name, or the path of its file from the script's folder.
        seed, clock, speed, estimator, time_limit: of the run; a realtime run has a speed.
        workers: rollout workers.
        settings: of the planner, as key=value.
        behind: services that dial the mangler's router; all others are on its other side.
        ends: how the run may end; other ends are failures.
        resumes: wall time from a fault's end to the next good plan, at most [s].
        wait: how long the robot waits for an answer in lockstep [s].
    """

    faults: tuple[Fault, ...]
    name: str = "script"
    task: str = "spot/move_box"
    seed: int = 1
    clock: str = "realtime"
    speed: float = 0.3
    estimator: str = "truth"
    time_limit: float = 4.0
    workers: int = 2
    settings: tuple[str, ...] = ("rollouts=10", "horizon=0.4")
    behind: tuple[str, ...] = ()
    ends: tuple[str, ...] = ("timeout", "success")
    resumes: float = 1.0
    wait: float = 30.0
    count: int = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "count", sum(fault.times for fault in self.faults))
        if not self.behind and any(not fault.is_process for fault in self.faults):
            raise UsageError(f"{self.name}: faults of messages need services behind the mangler")


def read_script(path: Path) -> Script:
    """Read a fault script.

    Raises:
        UsageError: there is no such file, or it is no script; the message names what is valid.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"no fault script at {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} is not TOML: {error}") from None
    faults = content.pop("faults", [])
    if not isinstance(faults, list) or not all(isinstance(fault, dict) for fault in faults):
        raise UsageError(f"{path}: faults are tables, [[faults]]")
    made = tuple(_made(Fault, fault, path) for fault in faults)
    script = _made(Script, {"name": path.stem, **content, "faults": made}, path)
    if script.task.endswith(".py"):
        return replace(script, task=str(path.parent / script.task))
    return script


def _made(kind: type, values: Mapping[str, Any], path: Path) -> Any:
    """Build a dataclass of values whose types are those of its defaults."""
    types = {f.name: type(f.default) for f in fields(kind) if f.init and f.default is not MISSING}
    types |= {"kind": str, "after_plan": int} if kind is Fault else {"faults": tuple}
    given = {}
    for name, read in values.items():
        if name not in types:
            raise UsageError(f"{path}: {unknown('entry', name, types)}")
        value = tuple(read) if isinstance(read, list) else read
        if types[name] is float and type(read) is int:
            value = float(read)
        if type(value) is not types[name]:
            raise UsageError(f"{path}: {name} needs a {types[name].__name__}, got {value!r}")
        given[name] = value
    missing = [n for n in ("kind", "after_plan") if kind is Fault and n not in given]
    if missing:
        raise UsageError(f"{path}: a fault needs {' and '.join(missing)}")
    return kind(**given)
