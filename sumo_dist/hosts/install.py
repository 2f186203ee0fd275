"""Having the same version on every host: what is missing is installed, what is there is left."""

import shlex
import sys
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

from sumo_dist.errors import SumoError
from sumo_dist.hosts.installation import Installation
from sumo_dist.hosts.inventory import Host
from sumo_dist.hosts.remote import Entry, Shell, last_line
from sumo_dist.hosts.wheel import built_wheel
from sumo_dist.terminal import say

INSTALL_S = 1800.0  # on a small machine with a slow network
_ENVIRONMENT = ".venv"


def program(host: Host) -> str:
    """Return the shell's words for `sumo-dist` on a host, in its folder."""
    python = shlex.quote(sys.executable) if host.is_local else f"{_ENVIRONMENT}/bin/python"
    return f"{python} -P -m sumo_dist"


def installed(host: Host) -> Installation | None:
    """Return what a host has; None if that is nothing that works.

    Raises:
        SumoError: it cannot be reached.
    """
    done = Shell(host).run(f"{program(host)} host-agent --identity")
    try:
        return Installation.from_json(last_line(done.stdout)) if done.returncode == 0 else None
    except SumoError:
        return None


def same_everywhere(hosts: Sequence[Host], view: bool) -> dict[str, Installation]:
    """Install this version where it is missing; return what each host has, by its name.

    Args:
        hosts: of the run.
        view: the tracer's host needs the viewer.

    Raises:
        SumoError: a host cannot be reached, or nothing can be installed there.
    """
    here = Installation.here()
    with ThreadPoolExecutor(len(hosts)) as pool:
        found = dict(zip([h.name for h in hosts], pool.map(installed, hosts), strict=True))
    lacking = [host for host in hosts if not _suffices(found[host.name], here, _view(host, view))]
    if lacking:
        with built_wheel() as wheel, ThreadPoolExecutor(len(lacking)) as pool:
            group = partial(_install_in_turn, wheel=wheel, view=view)
            for there in pool.map(group, _by_folder(lacking)):
                found |= there
    for host in hosts:
        if not _suffices(there := found[host.name], here, _view(host, view)):
            raise SumoError(
                f"host {host.name} has {there or 'no sumo-dist that works'}, not {here}"
            )
    return {name: there for name, there in found.items() if there is not None}


def install(host: Host, wheel: Path, view: bool) -> None:
    """Install a wheel, and what it needs from wherever that host gets packages.

    Raises:
        SumoError: that failed; the message has pip's last line.
    """
    if host.is_local:
        raise SumoError("this machine's tracer needs a viewer: pip install 'sumo-dist[view]'")
    shell = Shell(host)
    say(f"{host.name}: installing {wheel.name} in {host.folder}")
    shell.put("wheels", {wheel.name: Entry(wheel.read_bytes())})
    python = f"{_ENVIRONMENT}/bin/python"
    make = f"[ -x {python} ] || {shlex.quote(host.python)} -m venv {_ENVIRONMENT}"
    shell.must(make, f"make an environment with {host.python}", timeout=INSTALL_S)
    what = shlex.quote(f"wheels/{wheel.name}{'[view]' if view else ''}")
    pip = f"{python} -m pip install --no-input --quiet --disable-pip-version-check"
    # A wheel of the same version number is another one, after a change of the checkout.
    steps = f"{pip} {what} && {pip} --no-deps --force-reinstall wheels/{shlex.quote(wheel.name)}"
    shell.must(f"{steps}; code=$?; rm -rf wheels; exit $code", "install", timeout=INSTALL_S)


def _install_in_turn(
    hosts: Sequence[Host], wheel: Path, view: bool
) -> dict[str, Installation | None]:
    """Install on hosts that may share a file system: then the first has done it for all."""
    here, found = Installation.here(), {}
    for host in hosts:
        if not _suffices(there := installed(host), here, _view(host, view)):
            install(host, wheel, _view(host, view))
            there = installed(host)
        found[host.name] = there
    return found


def _view(host: Host, view: bool) -> bool:
    return view and "tracer" in host.roles


def _suffices(there: Installation | None, here: Installation, view: bool) -> bool:
    return there is not None and there.does_for(here) and (there.view or not view)


def _by_folder(hosts: Sequence[Host]) -> list[list[Host]]:
    """Hosts whose folders may be one folder, together."""
    groups: dict[str, list[Host]] = {}
    for host in hosts:
        groups.setdefault(host.folder, []).append(host)
    return list(groups.values())
