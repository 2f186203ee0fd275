"""The folder that a service is given with `--keys`: ca.pem, cert.pem and key.pem."""

from dataclasses import dataclass
from pathlib import Path

from sumo_dist.authority.certificates import (
    Certificate,
    KeysError,
    is_issued_by,
    read_certificate,
    read_key,
)
from sumo_dist.authority.store import CA, CERTIFICATE, KEY

SOON_DAYS = 14  # before a certificate's end, `doctor` and `keys show` warn


@dataclass(frozen=True)
class KeyFolder:
    """Keys of one role, read and found to belong together and to be valid.

    Attributes:
        path: of the folder.
        certificate: of the role.
    """

    path: Path
    certificate: Certificate

    @classmethod
    def read(cls, path: Path, roles: tuple[str, ...] = ()) -> "KeyFolder":
        """Read a folder.

        Args:
            path: of the folder.
            roles: that the keys may be for; () for any.

        Raises:
            KeysError: a file is missing, damaged, of another role or authority, or has expired.
        """
        path = path.absolute()
        if not path.is_dir():
            raise KeysError(f"{path} is no folder with {CA}, {CERTIFICATE} and {KEY}: see `keys`")
        ca, own = read_certificate(path / CA), read_certificate(path / CERTIFICATE)
        if read_key(path / KEY).public_key() != own.source.public_key():
            raise KeysError(f"{path / KEY} is not the key of {path / CERTIFICATE}")
        if not is_issued_by(own, ca):
            raise KeysError(f"{path / CERTIFICATE} was not issued by the authority of {path / CA}")
        if roles and own.role not in roles:
            role, wanted = own.role or "(none)", " or ".join(roles)
            raise KeysError(f"{path / CERTIFICATE} is for the role {role}; needed here: {wanted}")
        for file, one in ((CA, ca), (CERTIFICATE, own)):
            if reason := one.unfit():
                raise KeysError(
                    f"{path / file} has {reason}: `sumo-dist keys renew {own.host}` where the "
                    "authority is, then copy it here"
                    if reason.startswith("expired")
                    else f"{path / file} is {reason}?"
                )
        return cls(path, own)

    def file(self, name: str) -> str:
        """Path of a file of the folder."""
        return str(self.path / name)
