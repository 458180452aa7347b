"""Checks settings against their dataclass: a mapping of a yaml or command line in; an object out.

The fields of the dataclass are annotated with the types and ranges that a setting may have. A wrong
setting raises a ConfigError that names it and says what was expected.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from pipeline.core.errors import ConfigError

NAMES = {float: "a number", int: "a whole number", str: "a word", bool: "true or false"}
"""How an error calls what is expected of each type."""
LARGEST = 1e6
"""The largest number, and minus it the least, of a field that names no range."""
Filled = TypeVar("Filled")
"""The dataclass that is filled with settings."""
Build = Callable[[Any], Any]
"""Builds the object of a table whose key `_target_` names a class (`core.building`)."""


@dataclass(frozen=True)
class Range:
    """The numbers that a setting may have: `Annotated[float, Range(0.0, 1.0)]`."""

    low: float = -LARGEST
    high: float = LARGEST
    excludes_low: bool = False
    """Whether `low` itself is refused, so that a number must be above it."""
    wording: str = ""
    """What an error says that was expected; if empty, it names the end that was passed."""

    def expected(self, number: float) -> str:
        """What was expected instead of a number; empty if the number is in the range."""
        is_high_enough = self.low < number if self.excludes_low else self.low <= number
        if is_high_enough and number <= self.high:
            return ""
        if self.wording:
            return self.wording
        if number > self.high:
            return f"at most {self.high:,.10g}"
        if self.excludes_low:
            return f"a number above {self.low:g}"
        return f"a number of at least {self.low:g}"


Positive = Annotated[float, Range(0, excludes_low=True)]
NotNegative = Annotated[float, Range(0)]
Share = Annotated[float, Range(0, 1, wording="a share from 0 to 1")]
InnerShare = Annotated[
    float, Range(0, 1 - 1e-9, excludes_low=True, wording="a share between 0 and 1")
]
SomeShare = Annotated[float, Range(0, 1, excludes_low=True, wording="a share above 0, at most 1")]
Count = Annotated[int, Range(0, excludes_low=True)]
Whole = Annotated[int, Range(0)]
Side = Annotated[int, Range(0, 2_000, excludes_low=True)]
"""The side of an image, in cells or pixels."""
Seed = Annotated[int, Range(0, 2**32 - 1)]
Names = tuple[str, ...]
"""Names of sequences or models; on a command line they are one word, with blanks between."""


def filled(kind: type[Filled], table: Mapping[str, Any], build: Build, parent: str = "") -> Filled:
    """Fill the dataclass `kind` with the settings in `table`, each checked against its field.

    `parent` is put before a setting's name in an error, such as `grid.`. The setting `from` fills
    the field `from_`, since Python reserves the word. A setting that is null takes its field's
    default. Settings that `kind` has no field for are ignored: a stage takes what it needs of a
    group. Raises ConfigError for settings that are missing, of a wrong type or out of range.
    """
    hints = get_type_hints(kind, include_extras=True)
    values = {}
    missing = []
    for field in fields(kind):  # type: ignore[arg-type]  # mypy does not know it is a dataclass
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
    """A value as YAML of one line, for a word of a command line; `filled` reads it again.

    A dataclass becomes a table of those compared fields that differ from their defaults. A mapping
    becomes a list of pairs, so that a key such as 2012-01-15 is read as text, not as a date.
    """
    if is_dataclass(value):
        settings = []
        for field in fields(value):
            field_value = getattr(value, field.name)
            if field.compare and not _is_default(field, field_value):
                settings.append(f"{field.name}: {written(field_value)}")
        return f"{{{', '.join(settings)}}}"
    if isinstance(value, Mapping):
        pairs = [f"[{written(key)}, {written(item)}]" for key, item in value.items()]
        return f"[{', '.join(pairs)}]"
    if isinstance(value, Sequence) and not isinstance(value, str):
        return f"[{', '.join(map(written, value))}]"
    return json.dumps(value, ensure_ascii=False)


def _is_default(field: Field[Any], value: Any) -> bool:
    factory = field.default_factory
    default = field.default if factory is MISSING else factory()
    return bool(value == default)


def check(settings: Any, group: str) -> None:
    """Raise ConfigError for the first field of a dataclass that is not of its type and range.

    Fields may be numbers, words, booleans, literals, tables, lists of these, and null where the
    type allows it. A whole number is taken for a number too. `group` is put before the field's name
    in the error.
    """
    hints = get_type_hints(type(settings), include_extras=True)
    for field in fields(settings):
        value = getattr(settings, field.name)
        if expected := _expected(value, hints[field.name]):
            raise ConfigError(f"{group}.{field.name}={value}: expected {expected}")


def within(name: str, value: Any, hint: Any) -> None:
    """Raise ConfigError unless one value is of a type and range, such as `Count`.

    `name` is what the error calls the value.
    """
    if expected := _expected(value, hint):
        raise ConfigError(f"{name}={value}: expected {expected}")


def _value(name: str, value: Any, hint: Any, build: Build) -> Any:
    """A setting as its field has it: built, a path, a mapping, a tuple, or the value, checked."""
    origin = get_origin(hint)
    args = get_args(hint)
    if origin in (Union, UnionType):
        (hint_if_given,) = (arg for arg in args if arg is not NoneType)
        return _value(name, value, hint_if_given, build)
    is_recipe = isinstance(value, Mapping) and "_target_" in value
    if (hint is Any or is_dataclass(hint)) and is_recipe:
        return build(value)
    if is_dataclass(hint) and isinstance(hint, type):
        within(name, value, Mapping[str, Any])
        return filled(hint, value, build, f"{name}.")
    if hint is Path:
        return Path(str(value))
    if origin is Mapping:
        pairs = _pairs(name, value)
        _, item_hint = args
        return {str(key): _value(f"{name}.{key}", item, item_hint, build) for key, item in pairs}
    if origin is tuple:
        items = value.split() if isinstance(value, str) else value
        within(name, items, Sequence[Any])
        return tuple(_value(name, item, args[0], build) for item in items)
    within(name, value, hint)
    return value


def _pairs(name: str, value: Any) -> Any:
    """The pairs (key, value) of a mapping, or of the list of pairs that `written` makes of one."""
    if isinstance(value, Mapping):
        return value.items()
    within(name, value, Sequence[Any])
    return value


def _expected(value: Any, hint: Any) -> str:
    """What a type expects instead of a value; empty if it fits, or if the type is not checked."""
    origin = get_origin(hint)
    args = get_args(hint)
    if origin is Annotated:
        plain_hint, number_range = args  # as in Positive
        return _expected_of_scalar(value, plain_hint) or str(number_range.expected(value))
    if origin is Literal:
        *choices, last_choice = map(str, args)
        return "" if value in args else f"{', '.join(choices)} or {last_choice}"
    if origin in (Union, UnionType):
        return _expected_of_either(value, args)
    if origin is Mapping:
        return "" if isinstance(value, Mapping) else "a table"
    if is_dataclass(hint) and isinstance(hint, type):
        return "" if isinstance(value, hint) else f"a table of the settings of {hint.__name__}"
    if origin in (Sequence, tuple):
        return _expected_of_list(value, args[0])
    if hint in (int, float):
        return _expected_of_scalar(value, hint) or Range().expected(value)
    if hint in NAMES:
        return _expected_of_scalar(value, hint)
    return ""


def _expected_of_either(value: Any, hints: Sequence[Any]) -> str:
    """What a union of types expects; None among them allows null."""
    may_be_null = NoneType in hints
    expectations = [_expected(value, hint) for hint in hints if hint is not NoneType]
    if "" in expectations or (value is None and may_be_null):
        return ""
    return f"{expectations[0]} or null" if may_be_null else expectations[0]


def _expected_of_list(value: Any, item_hint: Any) -> str:
    """What a list of items of one type expects: what its first wrong item should be."""
    if isinstance(value, str) or not isinstance(value, Sequence):
        return "a list"
    expectations = (_expected(item, item_hint) for item in value)
    return next(filter(None, expectations), "")


def _expected_of_scalar(value: Any, hint: type) -> str:
    """The type that a number, a word or a boolean should have; Python's True is no number here."""
    is_bool = isinstance(value, bool)
    if hint is bool:
        fits = is_bool
    elif hint is float:
        fits = isinstance(value, int | float) and not is_bool and math.isfinite(value)
    else:
        fits = isinstance(value, hint) and not is_bool
    return "" if fits else NAMES[hint]
