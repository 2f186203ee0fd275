"""A digest of what functions compute: their source, and all that they refer to."""

import hashlib
import inspect
import sysconfig
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import fields, is_dataclass
from functools import cache, partial
from pathlib import Path
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

_PLAIN = (type(None), bool, int, float, complex, str, bytes, slice)
_INSTALLED = tuple({sysconfig.get_path(k) for k in ("stdlib", "platstdlib", "purelib", "platlib")})


def fingerprint(value: object, packages: Iterable[str] = ()) -> str:
    """SHA-256 that is equal in two processes in which the value means the same.

    Functions count with their source file and with whatever they hold or name: closures, defaults,
    bound arguments, globals, attributes of modules. Dataclasses, containers and arrays count with
    their content, other objects with their attributes. Installed packages count with their names.

    Args:
        value: functions, dataclasses, arrays and numbers, in containers or not.
        packages: top-level packages, besides this one, that are looked into although installed.
    """
    digest = _Digest(frozenset({__name__.partition(".")[0], *packages}))
    digest.add(value)
    return digest.sha256.hexdigest()


class _Digest:
    """Walks through a value, each function, class and module once."""

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
        elif isinstance(value, type) or (callable(value) and not is_dataclass(value)):
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
        elif isinstance(value, ModuleType):
            self._add_module(value)
        elif self._is_own(type(value)) and self._is_new(value):
            self._add_source(type(value))
            self.add(getattr(value, "__dict__", {}))

    def _add_module(self, module: ModuleType) -> None:
        """Add a user's module, of which nobody knows what it does when it is imported."""
        self._write(module.__name__)
        ours = module.__name__.partition(".")[0] == __name__.partition(".")[0]
        if not ours and self._is_own(module) and self._is_new(module):
            self._add_source(module)
            self._add_all(v for _, v in sorted(vars(module).items()) if isinstance(v, ModuleType))

    def _add_callable(self, value: Any) -> None:
        if isinstance(value, partial):
            self.add((value.func, value.args, value.keywords))
        elif isinstance(value, MethodType):
            self.add((value.__func__, value.__self__))
        elif isinstance(value, FunctionType | type):
            self._write(f"{value.__module__} {value.__qualname__}")
            if self._is_own(value) and self._is_new(value):
                self._add_source(value)
                if isinstance(value, FunctionType):
                    self._add_all(
                        (value.__defaults__, value.__kwdefaults__, *self._referred(value))
                    )
        elif self._is_own(type(value)):
            self.add((type(value).__call__, getattr(value, "__dict__", {})))
        else:
            self._write(getattr(value, "__name__", type(value).__qualname__))

    def _add_all(self, values: Iterable[Any]) -> None:
        for value in values:
            self.add(value)

    def _referred(self, function: FunctionType) -> Iterator[Any]:
        """Values of the closure's variables and of the globals that a function names, by name.

        Of a module of its own kind, those of its attributes that the function may mean: those with
        a name it uses.
        """
        yield from (cell.cell_contents for cell in function.__closure__ or ())
        names = sorted(_names(function.__code__))
        known = [name for name in names if name in function.__globals__]
        for name in known:
            value = function.__globals__[name]
            yield value
            if isinstance(value, ModuleType) and self._is_own(value):
                yield from (vars(value)[inner] for inner in names if inner in vars(value))

    def _is_own(self, value: Any) -> bool:
        """Whether a function, class or module is not merely installed, or of a package to see."""
        name = value.__name__ if isinstance(value, ModuleType) else value.__module__
        if name.partition(".")[0] in self._packages:
            return True
        source = _source(value)
        return source is not None and not source.startswith(_INSTALLED)

    def _is_new(self, value: Any) -> bool:
        new = id(value) not in self._visited
        self._visited[id(value)] = value
        return new

    def _add_source(self, value: Any) -> None:
        if source := _source(value):
            self._write(_content(source, Path(source).stat().st_mtime_ns))

    def _write(self, part: str | bytes) -> None:
        data = part.encode() if isinstance(part, str) else part
        self.sha256.update(len(data).to_bytes(8, "little") + data)


def _source(value: Any) -> str | None:
    try:
        return inspect.getsourcefile(value)
    except TypeError:  # built in
        return None


@cache
def _content(path: str, _changed_ns: int) -> bytes:
    return Path(path).read_bytes()


def _names(code: CodeType) -> set[str]:
    """Global names and attributes in a function and in those defined inside it."""
    inner = (_names(const) for const in code.co_consts if isinstance(const, CodeType))
    return set(code.co_names).union(*inner)
