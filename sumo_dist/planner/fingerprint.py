"""A digest of what functions compute: their source, and all that they refer to."""

import hashlib
import inspect
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from types import CodeType, FunctionType, MethodType
from typing import Any

import numpy as np

_PLAIN = (type(None), bool, int, float, complex, str, bytes, slice)


def fingerprint(value: object, packages: Iterable[str]) -> str:
    """SHA-256 that is equal in two processes in which the value means the same.

    Functions count with their source file and with whatever they hold or name: closures, defaults,
    bound arguments, globals. Dataclasses, containers and arrays count with their content, anything
    else with its type's name.

    Args:
        value: functions, dataclasses, arrays and numbers, in containers or not.
        packages: top-level modules whose functions are looked into; others count with their name.
    """
    digest = _Digest(frozenset(packages))
    digest.add(value)
    return digest.sha256.hexdigest()


class _Digest:
    """Walks through a value, each function once."""

    def __init__(self, packages: frozenset[str]) -> None:
        self.sha256 = hashlib.sha256()
        self._packages = packages
        self._visited: dict[int, object] = {}  # keeps what it has seen alive: an id stays its own

    def add(self, value: Any) -> None:
        if isinstance(value, _PLAIN):
            self._write(repr(value))
        elif isinstance(value, np.ndarray | np.generic):
            self._write(f"{value.dtype} {value.shape}")
            self._write(np.ascontiguousarray(value).tobytes())
        elif callable(value) and not is_dataclass(value):
            self._add_callable(value)
        else:
            self._add_content(value)

    def _add_content(self, value: Any) -> None:
        self._write(type(value).__qualname__)
        if is_dataclass(value):
            self._add_source(type(value))
            self.add({f.name: getattr(value, f.name) for f in fields(value)})
        elif isinstance(value, Mapping):
            self._add_all(part for key in sorted(value, key=repr) for part in (key, value[key]))
        elif isinstance(value, Set):
            self._add_all(sorted(value, key=repr))
        elif isinstance(value, Sequence):
            self._add_all(value)

    def _add_callable(self, value: Any) -> None:
        if isinstance(value, partial):
            self.add((value.func, value.args, value.keywords))
        elif isinstance(value, MethodType):
            self.add((value.__func__, value.__self__))
        elif isinstance(value, FunctionType | type):
            self._write(f"{value.__module__} {value.__qualname__}")
            own = value.__module__.partition(".")[0] in self._packages
            if own and id(value) not in self._visited:
                self._visited[id(value)] = value
                self._add_source(value)
                if isinstance(value, FunctionType):
                    self._add_all((value.__defaults__, value.__kwdefaults__, *_referred(value)))
        else:
            self._write(getattr(value, "__name__", type(value).__qualname__))

    def _add_all(self, values: Iterable[Any]) -> None:
        for value in values:
            self.add(value)

    def _add_source(self, value: Any) -> None:
        if source := inspect.getsourcefile(value):
            self._write(Path(source).read_bytes())

    def _write(self, part: str | bytes) -> None:
        data = part.encode() if isinstance(part, str) else part
        self.sha256.update(len(data).to_bytes(8, "little") + data)


def _referred(function: FunctionType) -> Iterator[Any]:
    """Values of the closure's variables and of the globals that a function names, by name."""
    yield from (cell.cell_contents for cell in function.__closure__ or ())
    named = sorted(_names(function.__code__) & set(function.__globals__))
    yield from (function.__globals__[name] for name in named)


def _names(code: CodeType) -> set[str]:
    """Global names and attributes in a function and in those defined inside it."""
    inner = (_names(const) for const in code.co_consts if isinstance(const, CodeType))
    return set(code.co_names).union(*inner)
