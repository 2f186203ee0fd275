"""Reaching a host: its shell, by the user's own `ssh`, and files to it and from it as a tar."""

import io
import shlex
import subprocess
import tarfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from sumo_dist.errors import SumoError
from sumo_dist.hosts.inventory import Host

TIMEOUT_S = 60.0
# No password is asked for in the middle of a run; a link that is cut ends ssh within seconds.
_SSH = (
    *("ssh", "-T", "-o", "BatchMode=yes", "-o", "ConnectTimeout=8"),
    *("-o", "ServerAliveInterval=3", "-o", "ServerAliveCountMax=2"),
)


@dataclass(frozen=True)
class Entry:
    """A file to be put on a host.

    Attributes:
        content: its bytes.
        mode: its permissions.
    """

    content: bytes
    mode: int = 0o644


@dataclass(frozen=True)
class Shell:
    """Commands on a host, each in its folder and with its environment."""

    host: Host

    def command(self, script: str) -> list[str]:
        """Return the words that run a script of POSIX shell there."""
        folder = in_shell(self.host.folder)
        exports = [f"export {name}={shlex.quote(value)}" for name, value in self.host.environment]
        whole = "; ".join([f"mkdir -p {folder} && cd {folder} || exit 1", *exports, script])
        if self.host.is_local:
            return ["sh", "-c", whole]
        port = ("-p", str(self.host.ssh_port)) if self.host.ssh_port else ()
        where = (*port, *self.host.ssh_options, self.host.ssh or self.host.name)
        return [*_SSH, *where, f"exec sh -c {shlex.quote(whole)}"]

    def run(
        self, script: str, given: bytes = b"", timeout: float = TIMEOUT_S
    ) -> subprocess.CompletedProcess[bytes]:
        """Run a script there to its end.

        Raises:
            SumoError: there is no ssh here, no answer in time, or no way to the host.
        """
        try:
            done = subprocess.run(
                self.command(script), input=given, capture_output=True, timeout=timeout, check=False
            )
        except FileNotFoundError:
            raise SumoError(
                f"host {self.host.name}: there is no ssh on this machine: install it, or start the "
                "services by hand as `run --hosts FILE --print` says"
            ) from None
        except subprocess.TimeoutExpired:
            raise SumoError(f"host {self.host.name}: no answer within {timeout:.0f} s") from None
        if done.returncode == 255 and not self.host.is_local:
            raise unreachable(self.host, last_line(done.stderr))
        return done

    def must(self, script: str, what: str, given: bytes = b"", timeout: float = TIMEOUT_S) -> bytes:
        """Run a script there that has to succeed; return what it wrote.

        Args:
            script: of POSIX shell.
            what: it does, for the error.
            given: on its standard input.
            timeout: until it must have ended [s].

        Raises:
            SumoError: it did not succeed; the message has its last line.
        """
        done = self.run(script, given, timeout)
        if done.returncode != 0:
            said = last_line(done.stderr) or f"exit code {done.returncode}"
            raise SumoError(f"host {self.host.name}: cannot {what}: {said}")
        return done.stdout

    def put(self, folder: str, files: Mapping[str, Entry]) -> None:
        """Write files below a folder of the host's folder, each by its relative path.

        Raises:
            SumoError: they cannot be written.
        """
        archive = io.BytesIO()
        with tarfile.open(fileobj=archive, mode="w") as tar:
            for name, entry in files.items():
                info = tarfile.TarInfo(name)
                info.size, info.mode = len(entry.content), entry.mode
                tar.addfile(info, io.BytesIO(entry.content))
        where = shlex.quote(folder)
        script = f"umask 077; mkdir -p {where} && tar -xopf - -C {where}"
        self.must(script, f"write to {folder}", archive.getvalue())

    def fetch(self, folder: str, out: Path) -> None:
        """Copy the content of a folder of the host's folder to one here.

        Raises:
            SumoError: it cannot be read, or not be written here.
        """
        where = shlex.quote(folder)
        command = self.command(f"mkdir -p {where} && tar -cf - -C {where} .")
        with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            assert process.stdout is not None, "it is a pipe"
            try:
                with tarfile.open(fileobj=process.stdout, mode="r|") as tar:
                    tar.extractall(out, filter="data")
            except (tarfile.TarError, OSError) as error:
                process.terminate()
                said = last_line(process.stderr.read() if process.stderr else b"") or error
                raise SumoError(
                    f"cannot copy {folder} of host {self.host.name} to {out}: {said}"
                ) from None


def in_shell(folder: str) -> str:
    """Return a folder as a shell's word; `~` is the home directory there."""
    if folder == "~":
        return '"$HOME"'
    if folder.startswith("~/"):
        return f'"$HOME"/{shlex.quote(folder[2:])}'
    return shlex.quote(folder)


def unreachable(host: Host, said: str) -> SumoError:
    """Build the error for a host that ssh cannot reach."""
    by = host.ssh or host.name
    reason = f": {said}" if said else ""
    return SumoError(f"host {host.name} cannot be reached{reason}; try: ssh -o BatchMode=yes {by}")


def last_line(said: bytes) -> str:
    """Return the last line that says something: what a user's shell says comes before."""
    lines = said.decode(errors="replace").split("\n")
    return printable(next((line.strip() for line in reversed(lines) if line.strip()), ""))


def printable(text: str) -> str:
    """Return a text of another host without what would steer a terminal."""
    return "".join(c if c.isprintable() else " " for c in text)
