"""TOML files of users: reading one, and building dataclasses of its tables."""

import tomllib
from collections.abc import Mapping
from dataclasses import MISSING, fields
from pathlib import Path
from typing import Any

from sumo_dist.errors import UsageError, unknown


def read_table(path: Path, what: str) -> dict[str, Any]:
    """Return the content of a TOML file.

    Args:
        path: of the file.
        what: it is, for the error.

    Raises:
        UsageError: there is no such file, or it is not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise UsageError(f"no {what} at {path}: {error.strerror}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UsageError(f"{path} is not TOML: {error}") from None


def made(kind: type, values: Mapping[str, Any], where: object = "", /, **required: type) -> Any:
    """Build a dataclass of values whose types are those of its defaults, or required ones.

    Raises:
        UsageError: an unknown name or a value of another type; it begins with `where`, if given.
    """
    begin = f"{where}: " if where else ""
    types = required | {f.name: type(f.default) for f in fields(kind) if f.default is not MISSING}
    given = {}
    for name, read in values.items():
        if name not in types:
            raise UsageError(f"{begin}{unknown('entry', name, types)}")
        value = tuple(read) if isinstance(read, list) else read
        if types[name] is float and type(read) is int:
            value = float(read)
        if type(value) is not types[name]:
            raise UsageError(f"{begin}{name} needs a {types[name].__name__}, got {value!r}")
        given[name] = value
    return kind(**given)
