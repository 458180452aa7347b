"""Checks settings of a yaml or command line against the types and ranges of their dataclass."""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pipeline.core.errors import ConfigError

NAMES = {float: "a number", int: "a whole number", str: "a word", bool: "true or false"}
LARGEST = 1e6
"""Of a number whose field says nothing else."""
Filled = TypeVar("Filled")
Build = Callable[[Any], Any]
"""Makes the object that a table with `_target_` describes."""


@dataclass(frozen=True)
class Range:
    """Which numbers a setting may be: `Annotated[float, Range(0.0, 1.0)]`."""

    low: float = -LARGEST
    high: float = LARGEST
    above: bool = False
    """`low` itself is none of them."""
    wording: str = ""
    """What was expected, where it is not the end that a number lies beyond."""

    def expected(self, number: float) -> str:
        """What was expected instead of a number; empty where it is in the range."""
        if (self.low < number if self.above else self.low <= number) and number <= self.high:
            return ""
        least = (
            f"a number above {self.low:g}" if self.above else f"a number of at least {self.low:g}"
        )
        return self.wording or (f"at most {self.high:,.10g}" if number > self.high else least)


Positive = Annotated[float, Range(0, above=True)]
NotNegative = Annotated[float, Range(0)]
Share = Annotated[float, Range(0, 1, wording="a share from 0 to 1")]
InnerShare = Annotated[float, Range(0, 1 - 1e-9, above=True, wording="a share between 0 and 1")]
SomeShare = Annotated[float, Range(0, 1, above=True, wording="a share above 0, at most 1")]
Count = Annotated[int, Range(0, above=True)]
Whole = Annotated[int, Range(0)]
Side = Annotated[int, Range(0, 2_000, above=True)]
"""Of an image, in cells or pixels."""
Seed = Annotated[int, Range(0, 2**32 - 1)]
Names = tuple[str, ...]
"""Of sequences or models; one word on a command line, with blanks between."""


def filled(kind: type[Filled], table: Mapping[str, Any], build: Build, parent: str = "") -> Filled:
    """Fill the dataclass `kind` with the settings in `table`, each checked against its field.

    `parent` comes before a field's name in an error, such as `grid.`. A field `from_` is the
    setting `from`, which Python keeps for itself. A setting that is null takes its field's default.
    Settings that `kind` has no field for are left out: a stage takes what it needs of a group.
    Raises ConfigError for settings that are missing, and for one of a wrong type or out of range.
    """
    hints = get_type_hints(kind, include_extras=True)
    values = {}
    missing = []
    for field in fields(kind):  # type: ignore[arg-type]
        setting = field.name.rstrip("_")
        value = table.get(setting)
        if value is not None:
            values[field.name] = _value(parent + setting, value, hints[field.name], build)
        elif field.default is MISSING and field.default_factory is MISSING:
            missing.append(parent + setting)
    if missing:
        raise ConfigError(f"not given: {', '.join(missing)}; `dvc repro` gives what a stage needs")
    return kind(**values)


def written(value: Any) -> str:
    """A value as a word of a command line and as a flow value of YAML; `filled` reads it again.

    A dataclass is a table of the fields that differ from their defaults and are compared, a mapping
    a list of pairs: keys such as 2012-01-15 are text then, whoever reads them.
    """
    if is_dataclass(value):
        parts = (
            f"{field.name}: {written(getattr(value, field.name))}"
            for field in fields(value)
            if field.compare and not _is_default(field, getattr(value, field.name))
        )
        return f"{{{', '.join(parts)}}}"
    if isinstance(value, Mapping):
        return f"[{', '.join(f'[{written(key)}, {written(of)}]' for key, of in value.items())}]"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(written, value))}]"
    return json.dumps(value, ensure_ascii=False)


def _is_default(field: Field[Any], value: Any) -> bool:
    factory = field.default_factory
    return bool(value == (field.default if factory is MISSING else factory()))


def check(settings: Any, group: str) -> None:
    """Raise ConfigError naming the first field whose value is not of its declared type and range.

    Numbers, words, switches, literals, what may be null, lists of these, tables. A whole number is
    a number too.
    """
    hints = get_type_hints(type(settings), include_extras=True)
    for field in fields(settings):
        value = getattr(settings, field.name)
        if expected := _expected(value, hints[field.name]):
            raise ConfigError(f"{group}.{field.name}={value}: expected {expected}")


def within(name: str, value: Any, hint: Any) -> None:
    """Raise ConfigError unless a value is of a type and range, such as `Count`.

    For a value that fills no dataclass.
    """
    if expected := _expected(value, hint):
        raise ConfigError(f"{name}={value}: expected {expected}")


def _value(name: str, value: Any, hint: Any, build: Build) -> Any:
    """A setting as its field has it: built, a path, a tuple of names, or checked as it is."""
    origin = get_origin(hint)
    args = get_args(hint)
    if origin in (Union, UnionType):
        (hint,) = (arg for arg in args if arg is not NoneType)
        return _value(name, value, hint, build)
    is_recipe = isinstance(value, Mapping) and "_target_" in value
    if (hint is Any or is_dataclass(hint)) and is_recipe:
        return build(value)
    if is_dataclass(hint) and isinstance(hint, type):
        within(name, value, Mapping[str, Any])
        return filled(hint, value, build, f"{name}.")
    if hint is Path:
        return Path(str(value))
    if origin is Mapping:
        pairs = value.items() if isinstance(value, Mapping) else value
        within(name, pairs, Sequence[Any] if pairs is value else Any)
        return {str(key): _value(f"{name}.{key}", of, args[1], build) for key, of in pairs}
    if origin is tuple:
        items = value.split() if isinstance(value, str) else value
        within(name, items, Sequence[Any])
        return tuple(_value(name, item, args[0], build) for item in items)
    within(name, value, hint)
    return value


def _expected(value: Any, hint: Any) -> str:
    """What a hint expects instead of a value; empty where it fits, or the hint is not checked."""
    origin = get_origin(hint)
    args = get_args(hint)
    if origin is Annotated:
        return _expected(value, args[0]) or str(args[1].expected(value))
    if origin is Literal:
        *choices, last_choice = map(str, args)
        return "" if value in args else f"{', '.join(choices)} or {last_choice}"
    if origin in (Union, UnionType):
        expectations = [_expected(value, arg) for arg in args if arg is not type(None)]
        return (
            ""
            if "" in expectations or (value is None and type(None) in args)
            else f"{expectations[0]}{' or null' * (type(None) in args)}"
        )
    if origin is Mapping:
        return "" if isinstance(value, Mapping) else "a table"
    if is_dataclass(hint) and isinstance(hint, type):
        return "" if isinstance(value, hint) else f"a table of the settings of {hint.__name__}"
    if origin in (Sequence, tuple):
        is_list = isinstance(value, Sequence) and not isinstance(value, str)
        return (
            next(filter(None, (_expected(item, args[0]) for item in value)), "")
            if is_list
            else "a list"
        )
    if hint is float:
        fits = (
            isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
        )
    else:
        fits = (
            isinstance(value, hint) and (hint is bool or not isinstance(value, bool))
            if hint in NAMES
            else True
        )
    return (
        (NAMES[hint] if not fits else Range().expected(value) if hint in (int, float) else "")
        if hint in NAMES
        else ""
    )
