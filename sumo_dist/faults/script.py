"""Fault scripts: what goes wrong in a run, when, and for how long. TOML files."""

import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, replace
from pathlib import Path
from typing import Any

from sumo_dist.errors import UsageError, unknown
from sumo_dist.faults.tamper import TAMPERS

PROCESS_FAULTS = ("kill", "freeze")
MESSAGE_FAULTS = ("drop", "delay", "narrow", "duplicate", "cut", *TAMPERS)
KINDS = (*PROCESS_FAULTS, *MESSAGE_FAULTS)
VIEWERS = ("", "web")


@dataclass(frozen=True)
class Fault:
    """Something that goes wrong, once or again and again.

    Attributes:
        kind: of a process, "kill" (SIGKILL, then started again) or "freeze" (SIGSTOP, then
            SIGCONT); of messages at the bridge, "drop", "delay" (by delay_ms and up to jitter_ms
            more, which also reorders them), "narrow" (each way takes kbit_s, and drops what would
            wait for longer than a second), "duplicate", one of TAMPERS, or "cut": the link is down
            and services vanish from each other's sight.
        target: the process it happens to; of messages, empty.
        after_plan: plan after which it begins.
        lasts: wall time until it is over [s].
        every: plans until it begins again.
        times: how often it happens.
        share: of messages that it happens to.
        topics: of these messages; empty means all.
        delay_ms, jitter_ms: of "delay".
        kbit_s: of "narrow", kilobits per second.
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
    kbit_s: float = 1000.0

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise unknown("fault", self.kind, KINDS)
        if not self.is_message and not self.target:
            raise UsageError(f"fault {self.kind!r} needs a target")
        if not 0 <= self.lasts <= 60:
            raise UsageError(f"fault {self.kind!r}: lasts must be from 0 to 60 s, got {self.lasts}")
        if not 0 < self.share <= 1:
            raise UsageError(f"fault {self.kind!r}: share must be in (0, 1], got {self.share}")
        if self.kbit_s <= 0:
            raise UsageError(f"fault {self.kind!r}: kbit_s must be positive, got {self.kbit_s}")
        if self.times < 1 or self.every < 1 or self.after_plan < 0:
            raise UsageError(f"fault {self.kind!r}: times and every must be at least 1")

    @property
    def is_message(self) -> bool:
        """Whether it happens to messages."""
        return self.kind in MESSAGE_FAULTS

    def concerns(self, topic: str) -> bool:
        """Whether it may happen to messages of a topic."""
        return not self.topics or topic in self.topics

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
        behind: services behind the bridge; all others are on its other side.
        viewer: "web", or "" for a run without tracer and viewer.
        ends: how the run may end; other ends are failures.
        resumes: wall time from a fault's end to the next good plan, at most [s].
        wait: how long the robot waits for an answer in lockstep [s].
        give_way: the workers let everything else on this machine go first.
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
    viewer: str = ""
    ends: tuple[str, ...] = ("timeout", "success")
    resumes: float = 1.0
    wait: float = 30.0
    give_way: bool = True

    def __post_init__(self) -> None:
        if not self.behind and any(fault.is_message for fault in self.faults):
            raise UsageError(f"{self.name}: faults of messages need services behind the bridge")
        if self.viewer not in VIEWERS:
            raise UsageError(f'{self.name}: viewer must be "web" or "", got {self.viewer!r}')

    @property
    def count(self) -> int:
        """How many faults happen."""
        return sum(fault.times for fault in self.faults)


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
    for fault in faults:
        if missing := [name for name in ("kind", "after_plan") if name not in fault]:
            raise UsageError(f"{path}: a fault needs {' and '.join(missing)}")
    made = tuple(_made(Fault, fault, path, kind=str, after_plan=int) for fault in faults)
    script = _made(Script, {"name": path.stem, **content, "faults": made}, path, faults=tuple)
    if script.task.endswith(".py"):
        return replace(script, task=str(path.parent / script.task))
    return script


def _made(made: type, values: Mapping[str, Any], path: Path, **required: type) -> Any:
    """Build a dataclass of values whose types are those of its defaults, or required ones."""
    types = required | {f.name: type(f.default) for f in fields(made) if f.default is not MISSING}
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
    return made(**given)
