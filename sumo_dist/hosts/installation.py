"""What is installed on a host, and whether it is what is installed here."""

import hashlib
import importlib.metadata
import json
import os
import platform
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path
from typing import Self

import sumo_dist
from sumo_dist.errors import SumoError
from sumo_dist.extras import lacking
from sumo_dist.provenance import cores
from sumo_dist.rollout import ENGINES, engine_identity

_CODE = (".py", ".xml", ".toml")


@dataclass(frozen=True)
class Installation:
    """An installation of this package, as it describes itself.

    Attributes:
        version: of the release.
        code: digest of its Python files, models and tables.
        builds: of each kind of engine that it has: equal builds give equal bits.
        python: version of the interpreter.
        machine: kind of processor.
        cores: that may be used.
        view: whether the viewer is installed.
    """

    version: str
    code: str
    builds: dict[str, str]
    python: str
    machine: str
    cores: int
    view: bool

    @classmethod
    def here(cls) -> Self:
        """Describe the one that runs."""
        return cls(
            version=importlib.metadata.version("sumo-dist"),
            code=code_digest(),
            builds=dict(_builds()),
            python=platform.python_version(),
            machine=platform.machine(),
            cores=cores(),
            view=not lacking("view"),
        )

    def to_json(self) -> str:
        """Return all that `from_json` needs."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str | bytes) -> Self:
        """Read what another installation said of itself.

        Raises:
            SumoError: it said something else.
        """
        try:
            said = json.loads(text)
            found = cls(**said)
            types = (str, str, dict, str, str, int, bool)
            if tuple(map(type, said.values())) == types:
                return found
        except (ValueError, TypeError):
            pass
        raise SumoError("its sumo-dist is of another kind than this one")

    @property
    def engine(self) -> str:
        """The build that says whether two engines were made of the same sources."""
        return self.builds.get("native-portable", "fallback")

    def does_for(self, other: Self) -> bool:
        """Whether it does in place of the other: another kind of processor has another engine."""
        same = (self.version, self.code) == (other.version, other.code)
        return same and (self.engine == other.engine or self.machine != other.machine)

    def __str__(self) -> str:
        return f"sumo-dist {self.version} ({self.code}, {self.engine}) on Python {self.python}"


def _builds() -> list[tuple[str, str]]:
    found = []
    for kind in ENGINES:
        try:
            found.append((kind, engine_identity(kind)[1]))
        except SumoError:  # it was installed without a compiler
            continue
    return found


@cache
def code_digest() -> str:
    """Digest of the files of this package that decide what it does, but for the compiled engine."""
    root = Path(sumo_dist.__file__).parent
    digest = hashlib.sha256()
    found = [
        Path(folder, name)
        for folder, _, names in os.walk(root, followlinks=True)
        for name in names
        if name.endswith(_CODE)
    ]
    for path in sorted(found, key=lambda path: path.relative_to(root).parts):
        content = path.read_bytes()
        digest.update(f"{path.relative_to(root).as_posix()} {len(content)}\n".encode())
        digest.update(content)
    return digest.hexdigest()[:12]
