"""What is pinned: which file of which wheel holds the weights of a policy."""

import tomllib
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from sumo_dist.errors import SumoError, unknown

MANIFEST = Path(__file__).with_name("manifest.toml")


@dataclass(frozen=True)
class Wheel:
    """A released wheel, used only as an archive: it is never installed or imported.

    Attributes:
        tag: "python-abi-platform", the compatibility tag of the pinned file.
        sha256: hash of the wheel file.
        bytes: size of the wheel file.
        credit: who holds the copyright.
    """

    name: str
    version: str
    tag: str
    sha256: str
    bytes: int
    licence: str
    credit: str

    @property
    def requirement(self) -> str:
        """Requirement specifier of exactly this release."""
        return f"{self.name}=={self.version}"


@dataclass(frozen=True)
class PinnedPolicy:
    """The weights file of a policy.

    Attributes:
        name: what the policy is called here.
        kind: which code computes its observation and joint targets.
        path: of the file inside the wheel.
    """

    name: str
    kind: str
    wheel: Wheel
    path: str
    sha256: str
    bytes: int

    @property
    def file_name(self) -> str:
        """Name in the cache; it carries the hash, so that releases never mix up their weights."""
        return f"{self.name}-{self.sha256[:12]}{PurePosixPath(self.path).suffix}"


def read_manifest(path: Path = MANIFEST) -> dict[str, PinnedPolicy]:
    """Read the pinned policies by name.

    Raises:
        SumoError: a table lacks a field, has an unknown one, or names a wheel that is not there.
    """
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    try:
        wheels = {name: Wheel(name=name, **table) for name, table in tables["wheels"].items()}
        return {
            name: PinnedPolicy(name=name, **{**table, "wheel": wheels[table["wheel"]]})
            for name, table in tables["policies"].items()
        }
    except (KeyError, TypeError) as error:
        raise SumoError(f"{path}: {error}") from None


def pinned_policy(name: str) -> PinnedPolicy:
    """Look a policy up in the manifest.

    Raises:
        UsageError: there is no policy of that name.
    """
    policies = read_manifest()
    if name not in policies:
        raise unknown("policy", name, policies)
    return policies[name]
