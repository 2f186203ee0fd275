"""The folder of an authority: its key, what it has issued, and the folders for the hosts.

    <home>/authority/    ca.pem ca.key issued.json
    <home>/hosts/<HOST>/<ROLE>/    ca.pem cert.pem key.pem, and of a router revoked.json

Who has `ca.key` can issue any role: it stays on the machine where keys are made.
"""

import fcntl
import json
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

from sumo_dist.authority.certificates import (
    NUMBERS,
    ROUTER,
    Certificate,
    Key,
    KeysError,
    certificate_pem,
    issue,
    key_pem,
    make_authority,
    new_key,
    read_certificate,
    read_file,
    read_key,
)

HOME = "SUMO_DIST_KEYS"
CA, CERTIFICATE, KEY, REVOKED = "ca.pem", "cert.pem", "key.pem", "revoked.json"
CA_KEY, ISSUED = "ca.key", "issued.json"


def home_of(given: Path | None) -> Path:
    """Return the folder of keys: the given one, that of the environment, or the usual one."""
    if given is not None:
        return given
    if named := os.environ.get(HOME):
        return Path(named)
    config = os.environ.get("XDG_CONFIG_HOME") or Path.home() / ".config"
    return Path(config, "sumo-dist", "keys")


@dataclass(frozen=True)
class Issued:
    """One certificate that was issued.

    Attributes:
        role, number, host: that it names.
        addresses: that were given for it.
        expires: when, as ISO 8601 text.
        revoked: it is not accepted any more.
    """

    role: str
    number: int
    host: str
    addresses: tuple[str, ...]
    expires: str
    revoked: bool = False

    @property
    def name(self) -> str:
        """Its common name."""
        return f"{self.role}.{self.number}"


class Authority:
    """An authority that is there."""

    def __init__(self, home: Path) -> None:
        """Open the authority of a folder of keys.

        Raises:
            KeysError: there is none.
        """
        self.home, self._own = home, home / "authority"
        if not (self._own / CA).exists():
            raise KeysError(f"no authority in {home}: make one with `sumo-dist keys init`")
        self.ca = read_certificate(self._own / CA)

    @classmethod
    def found(cls, home: Path) -> "Authority":
        """Make an authority.

        Raises:
            KeysError: there is one, or the folder cannot be written.
        """
        own = home / "authority"
        if own.exists():
            raise KeysError(f"{own} is there already: it is kept, and so is what it has issued")
        key = new_key()
        with _writing(home):
            home.mkdir(mode=0o700, parents=True, exist_ok=True)
            files = {CA: certificate_pem(make_authority(key)), CA_KEY: key_pem(key), ISSUED: b"[]"}
            _write_folder(own, files)
        return cls(home)

    def issued(self) -> list[Issued]:
        """Return all that was issued, in order.

        Raises:
            KeysError: the record cannot be read.
        """
        path = self._own / ISSUED
        try:
            rows = json.loads(read_file(path))
            return [Issued(**{**row, "addresses": tuple(row["addresses"])}) for row in rows]
        except (ValueError, TypeError, KeyError):
            raise KeysError(f"{path} is damaged: restore it from a copy") from None

    def host(self, host: str, roles: Sequence[str], addresses: Sequence[str], days: float) -> None:
        """Issue a key and a certificate for each role of a host.

        Raises:
            KeysError: it has one of these already.
        """
        with self._record() as record, _writing(self.home):
            for role in roles:
                if self.folder(host, role).exists():
                    raise KeysError(
                        f"{host} has keys for {role} in {self.folder(host, role)}: "
                        f"`sumo-dist keys renew {host}` prolongs them, `revoke` ends them"
                    )
            for role in roles:
                key = new_key()
                certificate = self._issue(record, (role, host), key, addresses, days)
                files = {CA: read_file(self._own / CA), CERTIFICATE: certificate, KEY: key_pem(key)}
                if role == ROUTER:
                    files[REVOKED] = _revoked(record)
                _write_folder(self.folder(host, role), files)

    def renew(self, host: str, days: float) -> list[str]:
        """Issue new certificates for the keys of a host; return its roles.

        The old ones stay good until they expire, so that what runs goes on.

        Raises:
            KeysError: it has none.
        """
        with self._record() as record, _writing(self.home):
            roles = self._roles(host)
            for role in roles:
                key = read_key(self.folder(host, role) / KEY)
                last = [one for one in record if (one.host, one.role) == (host, role)][-1]
                certificate = self._issue(record, (role, host), key, last.addresses, days)
                _write(self.folder(host, role) / CERTIFICATE, certificate)
        return roles

    def revoke(self, host: str, roles: Sequence[str] = ()) -> list[str]:
        """End all certificates of a host, or of some roles of it; return the routers to tell.

        Raises:
            KeysError: nothing of the kind was issued.
        """
        with self._record() as record, _writing(self.home):
            ended = [
                one
                for one in record
                if one.host == host and (not roles or one.role in roles) and not one.revoked
            ]
            if not ended:
                raise KeysError(f"nothing to revoke: {self._known(host)}")
            for one in ended:
                record[record.index(one)] = replace(one, revoked=True)
            for role in {one.role for one in ended}:
                shutil.rmtree(self.folder(host, role), ignore_errors=True)
            with suppress(OSError):  # other roles are left
                (self.home / "hosts" / host).rmdir()
            lists = sorted(self.home.glob(f"hosts/*/{ROUTER}/{REVOKED}"))
            for path in lists:
                _write(path, _revoked(record))
        return [path.parent.parent.name for path in lists]

    def folder(self, host: str, role: str) -> Path:
        """Folder of a host's role, which is to be copied there."""
        return self.home / "hosts" / host / role

    def exposed(self) -> list[Path]:
        """Return private keys that others than their user may read or change."""
        keys = [self._own / CA_KEY, *sorted(self.home.glob(f"hosts/*/*/{KEY}"))]
        return [path for path in keys if path.exists() and path.stat().st_mode & 0o077]

    def _roles(self, host: str) -> list[str]:
        folders = sorted((self.home / "hosts" / host).glob(f"*/{KEY}"))
        if not folders:
            raise KeysError(self._known(host))
        return [path.parent.name for path in folders]

    def _known(self, host: str) -> str:
        hosts = sorted({one.host for one in self.issued() if not one.revoked})
        return f"{host} has no valid keys here; those that have: {', '.join(hosts) or '(none)'}"

    def _issue(
        self,
        record: list[Issued],
        whose: tuple[str, str],
        key: Key,
        addresses: Sequence[str],
        days: float,
    ) -> bytes:
        role, host = whose
        number = 1 + max((one.number for one in record if one.role == role), default=0)
        if number > NUMBERS:
            raise KeysError(
                f"this authority has issued {NUMBERS} certificates of {role}, which is all it can: "
                "make another with `sumo-dist keys init --home` and move the hosts there"
            )
        lasts = timedelta(days=days)
        if datetime.now(UTC) + lasts > self.ca.expires:
            raise KeysError(f"the authority itself ends on {self.ca.expires:%Y-%m-%d}: fewer days")
        signers = self.ca.source, read_key(self._own / CA_KEY)
        made = issue(signers, key.public_key(), (role, number, host), addresses, lasts)
        expires = Certificate.of(made).expires.isoformat()
        record.append(Issued(role, number, host, tuple(addresses), expires))
        return certificate_pem(made)

    @contextmanager
    def _record(self) -> Iterator[list[Issued]]:
        """Yield what was issued, to be changed; it is written unless an error comes."""
        with _locked(self._own):
            record = self.issued()
            try:
                yield record
            finally:  # what was issued before an error is written down all the same
                _write(self._own / ISSUED, json.dumps([asdict(one) for one in record]).encode())


def read_revoked(folder: Path) -> frozenset[str]:
    """Return the common names that a router's folder says are revoked.

    Raises:
        KeysError: its list cannot be read; a router that does not know whom to refuse must not run.
    """
    path = folder / REVOKED
    try:
        names = json.loads(read_file(path))
    except ValueError:
        names = None
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise KeysError(f"{path} is damaged: copy it again from the machine with the authority")
    return frozenset(names)


def _revoked(record: Sequence[Issued]) -> bytes:
    return json.dumps([one.name for one in record if one.revoked]).encode()


def _write_folder(folder: Path, files: dict[str, bytes]) -> None:
    """Write a new folder, all of it or nothing."""
    for parent in (folder.parent.parent, folder.parent):
        parent.mkdir(mode=0o700, exist_ok=True)
    partial = folder.with_name(f".{folder.name}.{os.getpid()}")
    try:
        partial.mkdir(mode=0o700)
        for name, content in files.items():
            _write(partial / name, content)
        partial.rename(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _write(path: Path, content: bytes) -> None:
    """Write a file that its user alone can read, all of it or nothing."""
    partial = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        file = os.open(partial, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        with os.fdopen(file, "wb") as opened:
            opened.write(content)
            opened.flush()
            os.fsync(opened.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """Be the only one who issues from a folder."""
    try:
        file = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise KeysError(f"cannot read {folder}: {error.strerror}") from None
    try:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield
    finally:
        os.close(file)


@contextmanager
def _writing(home: Path) -> Iterator[None]:
    """Turn what the file system refuses into one line."""
    try:
        yield
    except OSError as error:
        where = error.filename or home
        raise KeysError(f"cannot write {where}: {error.strerror}") from None
