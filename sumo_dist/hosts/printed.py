"""What to type on each host of a run, for those who have no ssh to them."""

import shlex
from collections.abc import Sequence

from sumo_dist.hosts.install import program
from sumo_dist.hosts.inventory import Host, Inventory
from sumo_dist.hosts.orders import RUNS, certificates, keys_of, orders
from sumo_dist.hosts.protocol import Order
from sumo_dist.hosts.remote import in_shell
from sumo_dist.hosts.task_files import TASKS, TaskFiles, task_files
from sumo_dist.launch.deployment import Deployment
from sumo_dist.tasks import TASK_FILES

_HERE = "/@here@"  # stands for the folder while the commands are made
_RUN = "by-hand"


def printed(inventory: Inventory, deployment: Deployment) -> str:
    """Return one command for each host, with what has to be there before it is run."""
    task = task_files(deployment.episode.task)
    folders = {host.name: _HERE for host in inventory.hosts}
    found = orders(inventory, deployment, folders, _RUN, task)
    blocks = [_block(inventory, host, found[host.name], task) for host in inventory.hosts]
    first = (
        "# One command for each host, in this order within a minute or so: the host of the router "
        "first.\n# sumo-dist of this version has to be installed in .venv in each folder."
    )
    blocks.sort(key=lambda block: " router " not in block)
    return "\n\n".join([first, *blocks])


def _block(
    inventory: Inventory, host: Host, services: Sequence[Order], task: TaskFiles | None
) -> str:
    lines = [f"# {host.name}: {', '.join(order.name for order in services)}"]
    if task is not None:
        lines.append(f"# {task.name} and what is beside it must be in {host.folder}/{task.folder}")
    where = f"{host.folder}/{keys_of(host)}"
    lines += [
        f"# {inventory.keys}/hosts/{host.name}/{role} must be in {where}/{role}"
        for role in (certificates(inventory, host) if inventory.keys else ())
    ]
    if any(order.command in ("robot-interface", "tracer") for order in services):
        lines.append(f"# the recording will be in {host.folder}/{RUNS}/{_RUN}")
    return "\n".join([*lines, _command(host, services)])


def _command(host: Host, services: Sequence[Order]) -> str:
    """Return one command that ends its services together: with the last of them, or Ctrl-C."""
    *others, last = (_words(host, order) for order in services)
    exports = [f"export {name}={shlex.quote(value)}" for name, value in host.environment]
    steps = [f'export {TASK_FILES}="$PWD/{TASKS}"', *exports, "p="]
    steps += ["trap 'kill $p 2>/dev/null' EXIT", "trap 'exit 130' INT TERM HUP"]
    steps += [f'{words} & p="$p $!"' for words in others]
    script = "; ".join([*steps, last])
    folder = in_shell(host.folder)
    return f"mkdir -p {folder} && cd {folder} && sh -c {shlex.quote(script)}"


def _words(host: Host, order: Order) -> str:
    """Return a service as words of a shell that is in the host's folder."""
    words = (
        f'"$PWD"{shlex.quote(word.removeprefix(_HERE))}'
        if word.startswith(_HERE)
        else shlex.quote(word)
        for word in (order.command, *order.words)
    )
    return " ".join([program(host), *words])
