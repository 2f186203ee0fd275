"""What a message's fields may hold, declared in their annotations and checked on both ends.

A field is annotated with its rule, `Annotated[np.ndarray, Array("f4", "K", "n")]`; bare bool, int,
float, str, Literal, optional and dataclass annotations have the obvious rules. A rule packs a value
into what msgpack carries and unpacks it again, and raises WireError for anything it does not allow.
"""

import math
import operator
import re
import types
from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cache
from typing import Annotated, Any, Literal, Protocol, Union, get_args, get_origin, get_type_hints

import numpy as np

from sumo_dist.errors import SumoError

MAX_BYTES = 4 << 20  # of a message, hence of an array


class WireError(SumoError):
    """A message that cannot be sent or must not be believed.

    Attributes:
        reason: one word to count by: "size", "checksum", "malformed", "version", "type", "field",
            "dtype", "shape", "range" or "non-finite".
        detail: where and what.
    """

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason
        self.detail = detail


Dims = dict[str, int]
"""Sizes of a message's named dimensions; the first field that has a name sets its size."""


class Rule(Protocol):
    """Both directions of one field."""

    def pack(self, value: Any, dims: Dims) -> Any:
        """Turn a value into what msgpack carries."""
        ...

    def unpack(self, raw: Any, dims: Dims) -> Any:
        """Turn what msgpack carried into a value."""
        ...


@dataclass(frozen=True)
class Bool:
    """True or false."""

    def pack(self, value: Any, dims: Dims) -> bool:
        """Accept Python's and NumPy's booleans."""
        return self.unpack(bool(value) if isinstance(value, np.bool_) else value, dims)

    def unpack(self, raw: Any, dims: Dims) -> bool:
        """Accept booleans only."""
        if type(raw) is not bool:
            raise WireError("field", f"needs a boolean, got {type(raw).__name__}")
        return raw


@dataclass(frozen=True)
class Int:
    """An integer in [low, high]."""

    low: int = -(2**63)
    high: int = 2**63 - 1

    def pack(self, value: Any, dims: Dims) -> int:
        """Accept Python's and NumPy's integers."""
        return self.unpack(operator.index(value) if isinstance(value, np.integer) else value, dims)

    def unpack(self, raw: Any, dims: Dims) -> int:
        """Accept integers in range."""
        if type(raw) is not int:
            raise WireError("field", f"needs an integer, got {type(raw).__name__}")
        if not self.low <= raw <= self.high:
            raise WireError("range", f"{raw} is not in [{self.low}, {self.high}]")
        return raw


@dataclass(frozen=True)
class Float:
    """A finite number in [low, high]."""

    low: float = -math.inf
    high: float = math.inf

    def pack(self, value: Any, dims: Dims) -> float:
        """Accept Python's and NumPy's numbers."""
        number = isinstance(value, (int, float, np.floating, np.integer))
        return self.unpack(float(value) if number and type(value) is not bool else value, dims)

    def unpack(self, raw: Any, dims: Dims) -> float:
        """Accept finite numbers in range."""
        if type(raw) is not float:
            raise WireError("field", f"needs a float, got {type(raw).__name__}")
        if not math.isfinite(raw):
            raise WireError("non-finite", str(raw))
        if not self.low <= raw <= self.high:
            raise WireError("range", f"{raw} is not in [{self.low}, {self.high}]")
        return raw


@dataclass(frozen=True)
class Text:
    """A text of up to `longest` characters that matches a pattern, if one is given."""

    pattern: str | None = None
    longest: int = 10_000

    def pack(self, value: Any, dims: Dims) -> str:
        """Accept what unpack accepts."""
        return self.unpack(value, dims)

    def unpack(self, raw: Any, dims: Dims) -> str:
        """Accept matching texts."""
        if type(raw) is not str:
            raise WireError("field", f"needs a text, got {type(raw).__name__}")
        if len(raw) > self.longest:
            raise WireError("size", f"text of {len(raw)} characters, at most {self.longest}")
        if self.pattern is not None and not re.fullmatch(self.pattern, raw):
            raise WireError("range", f"{raw!r} does not match {self.pattern}")
        return raw


@dataclass(frozen=True)
class Lines:
    """Texts without line breaks, as many as a named dimension has; one text on the wire.

    Each has up to `longest` characters and matches a pattern, if one is given.
    """

    dim: str
    pattern: str | None = None
    longest: int = 200

    def pack(self, value: Any, dims: Dims) -> str:
        """Accept what unpack accepts."""
        if any("\n" in text for text in value):
            raise WireError("field", "a text with a line break")
        packed = "\n".join(value)
        self.unpack(packed, dims)
        return packed

    def unpack(self, raw: Any, dims: Dims) -> tuple[str, ...]:
        """Accept texts that match."""
        if type(raw) is not str:
            raise WireError("field", f"needs a text, got {type(raw).__name__}")
        texts, rule = tuple(raw.split("\n")), Text(self.pattern, self.longest)
        if dims.setdefault(self.dim, len(texts)) != len(texts):
            raise WireError("shape", f"{len(texts)} texts are not {dims[self.dim]}")
        for text in texts:
            rule.unpack(text, dims)
        return texts


@dataclass(frozen=True)
class Choice:
    """One of some texts (Literal)."""

    valid: tuple[str, ...]

    def pack(self, value: Any, dims: Dims) -> str:
        """Accept what unpack accepts."""
        return self.unpack(value, dims)

    def unpack(self, raw: Any, dims: Dims) -> str:
        """Accept the valid texts."""
        if type(raw) is not str or raw not in self.valid:
            raise WireError("range", f"{raw!r:.80} is none of {', '.join(self.valid)}")
        return raw


@dataclass(frozen=True)
class Optional:
    """A value or None."""

    rule: Rule

    def pack(self, value: Any, dims: Dims) -> Any:
        """Pack the value if there is one."""
        return None if value is None else self.rule.pack(value, dims)

    def unpack(self, raw: Any, dims: Dims) -> Any:
        """Unpack the value if there is one."""
        return None if raw is None else self.rule.unpack(raw, dims)


@dataclass(frozen=True)
class Settings:
    """Names with a whole number, a finite number or a text each."""

    def pack(self, value: Any, dims: Dims) -> dict[str, Any]:
        """Accept what unpack accepts."""
        return self.unpack(value, dims)

    def unpack(self, raw: Any, dims: Dims) -> dict[str, Any]:
        """Accept a map from texts to scalars."""
        if type(raw) is not dict:
            raise WireError("field", f"needs a map, got {type(raw).__name__}")
        for name, value in raw.items():
            rule = _SCALARS.get(type(value))
            if type(name) is not str or rule is None:
                raise WireError("field", f"{name!r:.80} is not a text with a number or a text")
            rule.unpack(value, dims)
        return raw


class Array:
    """A C-ordered array: [dtype, shape, raw little-endian bytes] on the wire.

    Unpacked arrays are read-only and own their memory.
    """

    def __init__(self, code: str, *dims: str | int, empty: bool = False) -> None:
        """Declare an array.

        Args:
            code: "f8", "f4", "i8" or "b1".
            dims: a size per dimension, or a name; equal names have equal sizes in a message.
            empty: whether a named dimension may be 0.
        """
        self.code = code
        self.dtype = np.dtype(f"<{code}")
        self.dims = dims
        self.empty = empty

    def __repr__(self) -> str:
        """Show the declaration."""
        return f"Array({self.code!r}, {self.dims}, empty={self.empty})"

    def pack(self, value: Any, dims: Dims) -> list[Any]:
        """Accept an array of exactly this type; casting is the sender's decision."""
        if not isinstance(value, np.ndarray) or value.dtype != self.dtype:
            found = value.dtype if isinstance(value, np.ndarray) else type(value).__name__
            raise WireError("dtype", f"needs {self.dtype}, got {found}")
        self._check(value, dims)
        return [self.code, value.shape, value.tobytes()]

    def unpack(self, raw: Any, dims: Dims) -> np.ndarray:
        """Rebuild the array."""
        if type(raw) is not list or len(raw) != 3:
            raise WireError("field", "needs [dtype, shape, bytes]")
        code, shape, data = raw
        if code != self.code:
            raise WireError("dtype", f"needs {self.code}, got {code!r:.80}")
        if type(shape) is not list or not all(type(n) is int and n >= 0 for n in shape):
            raise WireError("shape", f"{shape!r:.80} is not a shape")
        if type(data) is not bytes or math.prod(shape) * self.dtype.itemsize != len(data):
            raise WireError("shape", f"{shape} does not fit its data")
        if math.prod(n or 1 for n in shape) > MAX_BYTES:  # what NumPy may fail to index, with a 0
            raise WireError("shape", f"{shape} is too large")
        if self.code == "b1" and data.translate(None, b"\0\1"):
            raise WireError("range", "a boolean is neither 0 nor 1")
        array = np.frombuffer(data, self.dtype).reshape(shape)
        self._check(array, dims)
        return array

    def _check(self, array: np.ndarray, dims: Dims) -> None:
        fits = array.ndim == len(self.dims)
        for size, dim in zip(array.shape, self.dims, strict=False):
            if isinstance(dim, int):
                fits &= size == dim
            else:
                fits &= dims.setdefault(dim, size) == size and (size > 0 or self.empty)
        if not fits:
            known = {dim: dims[dim] for dim in self.dims if dim in dims}
            raise WireError("shape", f"{array.shape} is not {self.dims} with {known}")
        if self.dtype.kind == "f" and not np.isfinite(array).all():
            raise WireError("non-finite", f"{np.count_nonzero(~np.isfinite(array))} values")


class Fields:
    """Rules for fields of a dataclass that is declared elsewhere, in place of its annotations."""

    def __init__(self, **rules: Rule) -> None:
        """Give a rule per field."""
        self.rules = rules


class Record:
    """A dataclass: a map from field names to their values."""

    def __init__(self, kind: type, given: Mapping[str, Rule] | None = None) -> None:
        """Take the rules from the annotations, but for those that are given."""
        hints = get_type_hints(kind, include_extras=True)
        names = [field.name for field in fields(kind)]
        self.kind = kind
        self.rules = {name: (given or {}).get(name) or rule_for(hints[name]) for name in names}

    def __repr__(self) -> str:
        """Show the declaration."""
        return f"{self.kind.__name__}({self.rules})"

    def pack(self, value: Any, dims: Dims) -> dict[str, Any]:
        """Pack every field."""
        if type(value) is not self.kind:
            raise WireError("field", f"needs {self.kind.__name__}, got {type(value).__name__}")
        return self.pack_some({name: getattr(value, name) for name in self.rules}, dims)

    def pack_some(self, values: Mapping[str, Any], dims: Dims) -> dict[str, Any]:
        """Pack some fields, by name."""
        packed = {}
        for name, value in values.items():
            try:
                packed[name] = self.rules[name].pack(value, dims)
            except WireError as error:
                raise WireError(error.reason, f"{name}: {error.detail}") from None
        return packed

    def unpack(self, raw: Any, dims: Dims) -> Any:
        """Unpack every field; none may be missing or unknown."""
        if type(raw) is not dict or raw.keys() != self.rules.keys():
            found = sorted(map(str, raw)) if type(raw) is dict else type(raw).__name__
            raise WireError("field", f"needs {', '.join(self.rules)}; got {found!s:.200}")
        values = []
        for name, rule in self.rules.items():
            try:
                values.append(rule.unpack(raw[name], dims))
            except WireError as error:
                raise WireError(error.reason, f"{name}: {error.detail}") from None
        return self.kind(*values)


_SCALARS: dict[Any, Rule] = {bool: Bool(), int: Int(), float: Float(), str: Text()}


def rule_for(hint: Any) -> Rule:
    """Return the rule that an annotation declares."""
    if get_origin(hint) is Annotated:
        base, mark = get_args(hint)
        return Record(base, mark.rules) if isinstance(mark, Fields) else mark
    if get_origin(hint) is Literal:
        return Choice(get_args(hint))
    if get_origin(hint) in (Union, types.UnionType):
        (inner,) = (part for part in get_args(hint) if part is not types.NoneType)
        return Optional(rule_for(inner))
    return _SCALARS[hint] if hint in _SCALARS else Record(hint)


@cache
def record(kind: type) -> Record:
    """Return the rules of a message type."""
    return Record(kind)
