"""`sumo-dist doctor --hosts`: whether the hosts of a file can carry a run, before one starts."""

import json
import shlex
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta

from sumo_dist.authority.folder import SOON_DAYS
from sumo_dist.check.findings import Finding, examine
from sumo_dist.errors import SumoError
from sumo_dist.hosts.install import installed, program
from sumo_dist.hosts.installation import Installation
from sumo_dist.hosts.inventory import Host, Inventory
from sumo_dist.hosts.prepare import check_builds, host_keys
from sumo_dist.hosts.remote import Shell, last_line, printable

THERE = ("policies", "cores", "priority", "disk", "planning")  # checks that a host runs itself
TOLERATED_S = 1.0  # nothing is timed across hosts, but logs of different hosts should be in order
_ASKED = 5
_CLOCK = (
    "import sys, time\n"
    "for _ in iter(sys.stdin.readline, ''): print(time.time(), flush=True)"
)  # fmt: skip
_CONNECT = """import socket, sys
try: socket.create_connection((sys.argv[1], int(sys.argv[2])), 3).close(); print("listens")
except ConnectionRefusedError: print("free")
except OSError as error: print(error)"""
_CAN_INSTALL = """import ensurepip, platform, sys, venv
print(*sys.version_info[:2], platform.machine())"""
_THERE_S = 180.0

Findings = Iterator[tuple[str, str, Finding]]


def examined(inventory: Inventory) -> Findings:
    """Yield host, subject and finding of all that is looked at, host by host."""
    hosts = inventory.hosts
    with ThreadPoolExecutor(len(hosts)) as pool:
        done = [pool.submit(lambda host=host: list(_of_host(inventory, host))) for host in hosts]
        found: dict[str, Installation] = {}
        for host, findings in zip(hosts, done, strict=True):
            for subject, finding, there in findings.result():
                if there is not None:
                    found[host.name] = there
                yield host.name, subject, finding
    yield "all", "engines", examine(lambda: _builds(inventory, found))


def _of_host(
    inventory: Inventory, host: Host
) -> Iterator[tuple[str, Finding, Installation | None]]:
    shell = Shell(host)
    reached = examine(lambda: _reached(shell))
    yield "reach", reached, None
    if reached.level == "fail":
        return
    there = installed(host)
    yield "version", examine(lambda: _version(shell, there)), there
    checks: dict[str, Callable[[], Finding]] = {
        "router": lambda: _router(inventory, shell),
        "clock": lambda: _clock(shell),
        "keys": lambda: _keys(inventory, host),
    }
    for subject, check in checks.items():
        yield subject, examine(check), None
    if there is not None and there.does_for(Installation.here()):
        for subject, finding in _own(shell).items():
            yield subject, finding, None


def _reached(shell: Shell) -> Finding:
    began = time.monotonic()
    shell.must("true", f"use {shell.host.folder}")
    took = time.monotonic() - began
    if shell.host.is_local:
        return Finding("ok", f"this machine, {shell.host.folder}")
    return Finding("ok", f"{shell.host.ssh or shell.host.name} answers in {took * 1e3:.0f} ms")


def _version(shell: Shell, there: Installation | None) -> Finding:
    """Is this version there, and if not, can it be installed."""
    here = Installation.here()
    if there is not None and there.does_for(here):
        return Finding("ok", str(there))
    python = shlex.join((shell.host.python, "-c", _CAN_INSTALL))
    words = last_line(shell.must(python, f"use {shell.host.python} (python = ...)")).split()
    if words != (wanted := [*here.python.split(".")[:2], here.machine]):
        return Finding(
            "fail",
            f"{shell.host.python} is {'.'.join(words[:2])} on {words[2]}, what is built here is for"
            f" {'.'.join(wanted[:2])} on {wanted[2]}: name another python, or install by hand",
        )
    found = there or "no sumo-dist that works"
    return Finding("warn", f"{found}, here it is {here}: `run --hosts` installs that")


def _router(inventory: Inventory, shell: Shell) -> Finding:
    """Can the host reach where the router will be."""
    address, port = inventory.address
    words = shlex.join((_python(shell.host), "-c", _CONNECT, address, str(port)))
    said = last_line(shell.must(words, "run Python"))
    where = inventory.endpoint
    if said == "free":
        return Finding("ok", f"reaches {where}, where nobody listens yet")
    if said == "listens":
        return Finding("warn", f"somebody listens at {where} already")
    return Finding("fail", f"cannot reach {where}: {said}")


def _clock(shell: Shell) -> Finding:
    """How far the host's clock is off this one's: the answer that came fastest says."""
    command = shell.command(shlex.join((_python(shell.host), "-c", _CLOCK)))
    best = (float("inf"), 0.0)
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdin and process.stdout, "they are pipes"
        for _ in range(_ASKED):
            began = time.time()
            process.stdin.write(b"\n")
            process.stdin.flush()
            said = process.stdout.readline()
            took = time.time() - began
            best = min(best, (took, float(said or "nan") - began - took / 2))
        process.stdin.close()
    took, off = best
    text = f"{off:+.3f} s to this machine's (within {took / 2:.3f} s)"
    if abs(off) > TOLERATED_S:
        return Finding("warn", f"{text}: runs do not mind, who reads logs will")
    return Finding("ok", text)


def _keys(inventory: Inventory, host: Host) -> Finding:
    if not inventory.keys:
        alone = "loopback only" if inventory.is_loopback else "insecure = true"
        return Finding("ok" if inventory.is_loopback else "warn", f"none: {alone}")
    keys = host_keys(inventory, host)
    first = min(keys, key=lambda one: one.certificate.expires)
    text = ", ".join(one.certificate.role for one in keys)
    text += (
        f"; that of {first.certificate.role} ends first, on {first.certificate.expires:%Y-%m-%d}"
    )
    if first.certificate.expires < datetime.now(UTC) + timedelta(days=SOON_DAYS):
        return Finding(
            "warn", f"{text}: `sumo-dist keys renew {host.name} --home {inventory.keys}`"
        )
    return Finding("ok", text)


def _own(shell: Shell) -> Mapping[str, Finding]:
    """Return what the host's own doctor says."""
    words = f"{program(shell.host)} doctor --json --only {' '.join(THERE)}"
    done = shell.run(words, timeout=_THERE_S)
    try:
        said = json.loads(last_line(done.stdout))
        return {name: Finding(level, printable(text)) for name, (level, text) in said.items()}
    except (ValueError, TypeError, AttributeError):
        return {"doctor": Finding("fail", f"exit code {done.returncode}")}


def _python(host: Host) -> str:
    return "python3" if host.is_local else host.python


def _builds(inventory: Inventory, found: Mapping[str, Installation]) -> Finding:
    """Have all that plan or roll out one build of the engine."""
    planners = [h for h in inventory.hosts if h.workers or "optimizer" in h.roles]
    if any(host.name not in found for host in planners):
        return Finding("skip", "not compared: a host has no sumo-dist yet")
    try:
        check_builds(inventory, found, "auto")
    except SumoError as error:
        return Finding("fail", str(error))
    return Finding("ok", "one build on all hosts that plan or roll out")
