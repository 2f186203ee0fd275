"""What hosts need before a run: the same version, the same engine, task files, keys, weights."""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from sumo_dist.authority.folder import KeyFolder
from sumo_dist.errors import SumoError
from sumo_dist.hosts.install import same_everywhere
from sumo_dist.hosts.installation import Installation
from sumo_dist.hosts.inventory import Host, Inventory
from sumo_dist.hosts.orders import certificates, keys_of
from sumo_dist.hosts.remote import Entry, Shell
from sumo_dist.hosts.task_files import TaskFiles


def prepare(
    inventory: Inventory, engine: str, view: bool, task: TaskFiles | None
) -> dict[str, Installation]:
    """Bring all hosts up to this version and give them their files.

    Args:
        inventory: of the hosts.
        engine: kind of engine of those that name none.
        view: the tracer's host needs the viewer.
        task: of a user, if it is one.

    Returns:
        What each host has, by its name.

    Raises:
        SumoError: a host lacks something; the message says what.
    """
    keys = {host.name: key_files(inventory, host) for host in inventory.hosts}
    found = same_everywhere(inventory.hosts, view)
    check_builds(inventory, found, engine)

    def equip(host: Host) -> None:
        shell = Shell(host)
        if task is not None:
            shell.put(task.folder, task.files)
        if keys[host.name]:
            shell.put(keys_of(host), keys[host.name])

    each(inventory.hosts, equip)
    return found


def each(hosts: Sequence[Host], do: Callable[[Host], None]) -> None:
    """Do something on all hosts at once."""
    with ThreadPoolExecutor(len(hosts)) as pool:
        list(pool.map(do, hosts))


def key_files(inventory: Inventory, host: Host) -> dict[str, Entry]:
    """Return the keys of a host's services, by their paths in its folder of keys.

    Raises:
        SumoError: some are missing, or not fit for it.
    """
    return {
        f"{keys.path.name}/{file.name}": Entry(file.read_bytes(), mode=0o600)
        for keys in host_keys(inventory, host)
        for file in keys.path.iterdir()
    }


def host_keys(inventory: Inventory, host: Host) -> list[KeyFolder]:
    """Read the keys of a host's services, a folder a role; none where a run has no keys.

    Raises:
        SumoError: some are missing, or not fit for it.
    """
    if not inventory.keys:
        return []
    folder, roles = Path(inventory.keys, "hosts", host.name), certificates(inventory, host)
    if missing := [role for role in roles if not (folder / role).is_dir()]:
        raise SumoError(
            f"host {host.name} has no keys in {folder} for {', '.join(missing)}: `sumo-dist keys "
            f"host {host.name} --role {','.join(missing)} --home {inventory.keys}` makes them"
        )
    return [KeyFolder.read(folder / role, (role,)) for role in roles]


def check_builds(inventory: Inventory, found: Mapping[str, Installation], engine: str) -> None:
    """See that optimizer and workers have one build of the engine: others would be left out.

    Raises:
        SumoError: they have not.
    """
    planners = [h for h in inventory.hosts if h.workers or "optimizer" in h.roles]
    builds = {h.name: found[h.name].builds.get(h.engine or engine, "none") for h in planners}
    if len(set(builds.values())) > 1:
        listed = "; ".join(f"{name}: {build}" for name, build in builds.items())
        raise SumoError(
            f"hosts have different builds of the engine, whose costs may differ in the last bit "
            f"({listed}); if only the instruction sets differ, give all of them --engine "
            "native-portable, else let their sumo-dist be installed anew"
        )
