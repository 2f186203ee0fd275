"""Hosts as network namespaces with an sshd each, on one bridge. Needs root, ip and OpenSSH."""

import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

SSHD = "/usr/sbin/sshd"


def lacking():
    """Say what is missing for such hosts; "" if nothing is."""
    if os.geteuid() != 0:
        return "needs root, to make network namespaces"
    missing = [name for name in ("ip", "ssh", "ssh-keygen", SSHD) if shutil.which(name) is None]
    if missing:
        return f"needs {', '.join(missing)}: apt-get install openssh-server openssh-client iproute2"
    if call("ip", "netns", "add", probe := f"sd{os.getpid()}probe", check=False).returncode:
        return "network namespaces cannot be made here"
    call("ip", "netns", "del", probe)
    return ""


def call(*words, check=True):
    done = subprocess.run(words, capture_output=True, text=True, check=False, timeout=30)
    assert not check or done.returncode == 0, f"{words}: {done.stderr}"
    return done


class Network:
    """Hosts on a bridge; the launcher is on it, too, as a router or switch would be."""

    def __init__(self, folder: Path, names):
        self.folder, self.names = folder, list(names)
        number = os.getpid() % 60_000
        self._prefix = f"10.{64 + number // 250 % 64}.{number % 250}"
        self._bridge = f"sdb{number}"
        self._daemons = []
        self._number = number

    def __enter__(self):
        Path("/run/sshd").mkdir(exist_ok=True)
        self.folder.mkdir(parents=True, exist_ok=True)
        for key in ("host_key", "user_key"):
            call("ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", self.folder / key)
        call("ip", "link", "add", self._bridge, "type", "bridge")
        call("ip", "addr", "add", f"{self.launcher}/24", "dev", self._bridge)
        call("ip", "link", "set", self._bridge, "up")
        for name in self.names:
            self._add(name)
        return self

    def __exit__(self, *_):
        for daemon in self._daemons:
            daemon.terminate()
            daemon.wait(10)
        for name in self.names:
            for pid in self.processes(name):
                os.kill(pid, 9)
            call("ip", "netns", "del", self.space(name), check=False)
        call("ip", "link", "del", self._bridge, check=False)

    def space(self, name):
        return f"sd{self._number}{name}"

    def address(self, name):
        return f"{self._prefix}.{self.names.index(name) + 1}"

    @property
    def launcher(self):
        """Address of this machine on the bridge."""
        return f"{self._prefix}.254"

    def destination(self, name):
        return f"root@{self.address(name)}"

    def home(self, name):
        return self.folder / name

    def _cable(self, name):
        return f"sd{self._number}v{self.names.index(name)}"

    def _add(self, name):
        space, cable, inner = self.space(name), self._cable(name), f"{self._cable(name)}i"
        call("ip", "netns", "add", space)
        call("ip", "link", "add", cable, "type", "veth", "peer", "name", inner)
        call("ip", "link", "set", cable, "master", self._bridge, "up")
        call("ip", "link", "set", inner, "netns", space, "name", "eth0")
        for words in (
            ("addr", "add", f"{self.address(name)}/24", "dev", "eth0"),
            ("link", "set", "eth0", "up"),
            ("link", "set", "lo", "up"),
        ):
            call("ip", "-n", space, *words)
        self.home(name).mkdir()
        (self.home(name) / ".venv").symlink_to(sys.prefix)
        options = {
            "HostKey": self.folder / "host_key",
            "AuthorizedKeysFile": self.folder / "user_key.pub",
            "PidFile": self.folder / f"{name}.pid",
            "StrictModes": "no",
            "UsePAM": "no",
            "PermitRootLogin": "yes",
        }
        words = [word for key, value in options.items() for word in ("-o", f"{key}={value}")]
        command = ["ip", "netns", "exec", space, SSHD, "-D", "-f", "/dev/null", *words]
        self._daemons.append(
            subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        )

    @property
    def ssh_options(self):
        return [
            *("-i", str(self.folder / "user_key"), "-o", "StrictHostKeyChecking=no"),
            *("-o", "UserKnownHostsFile=/dev/null", "-o", "LogLevel=ERROR", "-F", "none"),
        ]

    def cut(self, name):
        call("ip", "link", "set", self._cable(name), "down")

    def mend(self, name):
        call("ip", "link", "set", self._cable(name), "up")

    def processes(self, name):
        """Processes of a host, but for its sshd."""
        found = call("ip", "netns", "pids", self.space(name)).stdout.split()
        return [int(pid) for pid in found if "sshd" not in command_of(pid)]

    def table(self, name, **entries):
        """A host of a hosts file."""
        values = {"folder": str(self.home(name)), **entries}
        if name != "local":
            values |= {"ssh": self.destination(name), "ssh_options": self.ssh_options}
        # A list or a text of TOML is written as in Python, but for its quotes.
        lines = (
            f"{key} = {repr(value).replace(chr(39), chr(34))}" for key, value in values.items()
        )
        return "\n".join([f"[hosts.{name}]", *lines, ""])

    def reachable(self):
        """Wait until every sshd answers."""
        for name in self.names:
            words = ("ssh", "-o", "BatchMode=yes", *self.ssh_options, self.destination(name))
            deadline = time.monotonic() + 30
            while call(*words, "true", check=False).returncode != 0:
                assert time.monotonic() < deadline, f"{name} does not answer"
                time.sleep(0.1)


def children(pid):
    return [int(child) for child in call("pgrep", "-P", str(pid), check=False).stdout.split()]


def command_of(pid):
    try:
        return Path("/proc", str(pid), "cmdline").read_bytes().replace(b"\0", b" ").decode()
    except OSError:
        return "sshd"  # it has ended
