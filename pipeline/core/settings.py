"""Checks settings against their dataclass: a table of a file or command line in; an object out.

This serves all that people write or that is read again: the stages' settings, conf/studies.yaml,
the site.json of a site, the study beside its results and the records of a sweep. The fields of a
dataclass are annotated with the types and ranges that a setting may have. A wrong setting raises a
ConfigError that names it and says what was expected. `plain` and `written` are the way back.
"""

import json
import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import MISSING, dataclass, fields, is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import (
    Annotated,
    Any,
    Literal,
    TypeVar,
    Union,
    get_args,
    get_origin,
    get_type_hints,
)

from pipeline.core.errors import ConfigError, InputError

NAMES = {float: "a number", int: "a whole number", str: "a word", bool: "true or false"}
"""How an error calls what is expected of each type."""
LARGEST = 1e6
"""The largest number, and minus it the least, that a field with no wider range may be set to."""
Filled = TypeVar("Filled")
"""The dataclass that is filled with settings."""
Resolve = Callable[[Any, Any], Any]
"""Takes the type of a field, a dataclass or Any, and its setting.

Returns the object or the table that the setting stands for, such as the object of a table with the
key `_target_`, or else the setting itself.
"""


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
WORDS = "words"
"""Marks a list that may also be given as one text, with blanks between its words."""
Names = Annotated[tuple[str, ...], WORDS]
"""Names of sequences or models."""


def filled(
    kind: type[Filled],
    table: Mapping[str, Any],
    resolve: Resolve = lambda _, setting: setting,
    parent: str = "",
    advice: str = "",
) -> Filled:
    """Fill the dataclass `kind` with the settings in `table`, each checked against its field.

    The setting `from` fills the field `from_`, since Python reserves the word. A setting that is
    null takes its field's default, or stays null where the type allows it. Settings that `kind` has
    no field for are ignored: a stage takes what it needs of a group. `parent` is put before a
    setting's name in an error, such as `grid.`, and `advice` behind one on settings that are
    missing. Raises ConfigError for these, and for one of a wrong type or out of range.
    """
    hints = get_type_hints(kind, include_extras=True)
    values = {}
    missing = []
    for field in fields(kind):  # type: ignore[arg-type]  # mypy does not know it is a dataclass
        setting = field.name.rstrip("_")
        hint = hints[field.name]
        value = table.get(setting)
        if value is not None:
            values[field.name] = _value(parent + setting, value, hint, resolve)
        elif field.default is MISSING and field.default_factory is MISSING:
            if setting in table and NoneType in get_args(hint):
                values[field.name] = None
            else:
                missing.append(parent + setting)
    if missing:
        raise ConfigError(f"not given: {', '.join(missing)}{advice}")
    try:
        return kind(**values)
    except InputError as error:
        raise ConfigError(f"{parent.rstrip('.')}: {error}") from None


def plain(value: Any, whole: bool = False) -> Any:
    """A value as a file can hold it: a dataclass becomes a table, a tuple a list.

    Of a dataclass, the compared fields are written that differ from their defaults; if `whole`, all
    but those that are null by default.
    """
    if is_dataclass(value):
        return {name: plain(item, whole) for name, item in _settings(value, whole)}
    if isinstance(value, Mapping):
        return {key: plain(item, whole) for key, item in value.items()}
    if _is_list(value):
        return [plain(item, whole) for item in value]
    return value


def written(value: Any) -> str:
    """A value as YAML of one line, for a word of a command line; `filled` reads it again.

    A dataclass becomes a table as in `plain`. A mapping becomes a list of pairs, so that a key such
    as 2012-01-15 is read as text, not as a date.
    """
    if is_dataclass(value):
        settings = (f"{name}: {written(field_value)}" for name, field_value in _settings(value))
        return f"{{{', '.join(settings)}}}"
    if isinstance(value, Mapping):
        pairs = (f"[{written(key)}, {written(item)}]" for key, item in value.items())
        return f"[{', '.join(pairs)}]"
    if _is_list(value):
        return f"[{', '.join(map(written, value))}]"
    return json.dumps(value, ensure_ascii=False)


def _settings(instance: Any, whole: bool = False) -> Iterator[tuple[str, Any]]:
    """The fields of a dataclass that `plain` writes, with their values."""
    for field in fields(instance):
        value = getattr(instance, field.name)
        default = field.default if field.default_factory is MISSING else field.default_factory()
        is_left_out = value == default and (value is None or not whole)
        if field.compare and not is_left_out:
            yield field.name, value


def check(settings: Any, group: str) -> None:
    """Raise ConfigError for the first field of a dataclass that is not of its type and range.

    Fields may be numbers, words, booleans, literals, tables, lists of these, and null where the
    type allows it. A whole number is taken for a number too. `group` is put before the field's name
    in the error.
    """
    hints = get_type_hints(type(settings), include_extras=True)
    for field in fields(settings):
        within(f"{group}.{field.name}", getattr(settings, field.name), hints[field.name])


def checked(group: str) -> Callable[[type[Filled]], type[Filled]]:
    """Decorate a class, below `@dataclass`, so that `check` is called as soon as it is made.

    Its own `__post_init__`, if it has one, is called after that.
    """

    def decorate(cls: type[Filled]) -> type[Filled]:
        post_init: Callable[[Any], None] | None = cls.__dict__.get("__post_init__")

        def check_first(settings: Any) -> None:
            check(settings, group)
            if post_init:
                post_init(settings)

        cls.__post_init__ = check_first  # type: ignore[attr-defined]  # dataclass calls it
        return cls

    return decorate


def within(name: str, value: Any, hint: Any) -> None:
    """Raise ConfigError unless one value is of a type and range, such as `Count`.

    `name` is what the error calls the value.
    """
    _value(name, value, hint, None)


def refused(name: str, value: Any, expected: str) -> ConfigError:
    """The error on a setting's value that says what was expected instead."""
    return ConfigError(f"{name}={value!s:.100}: expected {expected}")


def _value(name: str, value: Any, hint: Any, resolve: Resolve | None) -> Any:
    """A setting in the type of its field, checked; without `resolve` it must be of the type."""
    origin = get_origin(hint)
    args = get_args(hint)
    if origin is Annotated:
        return _annotated(name, value, hint, resolve)
    if origin is Literal:
        if value not in args:
            *choices, last_choice = map(str, args)
            raise refused(name, value, f"{', '.join(choices)} or {last_choice}")
    elif origin in (Union, UnionType):
        return _either(name, value, args, resolve)
    elif origin is Mapping:
        pairs = _pairs(name, value, is_table=resolve is None)
        return {str(key): _value(f"{name}.{key}", item, args[1], resolve) for key, item in pairs}
    elif origin in (Sequence, tuple):
        return _items(name, value, args, resolve)
    elif hint is Any or is_dataclass(hint):
        return _object(name, value, hint, resolve)
    elif hint is Path:
        return Path(str(value))
    elif hint in NAMES:
        _check_scalar(name, value, hint)
        if hint in (int, float) and resolve is None:
            _check_range(name, value, Range())
    return value


def _annotated(name: str, value: Any, hint: Any, resolve: Resolve | None) -> Any:
    """A number within a range, or words of one text."""
    plain_hint, detail = get_args(hint)
    if detail == WORDS:
        words = value.split() if isinstance(value, str) and resolve else value
        return _value(name, words, plain_hint, resolve)
    _check_scalar(name, value, plain_hint)
    _check_range(name, value, detail)
    return value


def _check_scalar(name: str, value: Any, hint: type) -> None:
    """Raise ConfigError unless a value has a type of NAMES; Python's True is no number here."""
    kinds = int | float if hint is float else hint
    fits = isinstance(value, kinds) and isinstance(value, bool) == (hint is bool)
    if not fits or (hint is float and not math.isfinite(value)):
        raise refused(name, value, NAMES[hint])


def _check_range(name: str, value: float, numbers: Range) -> None:
    if expected := numbers.expected(value):
        raise refused(name, value, expected)


def _either(name: str, value: Any, hints: Sequence[Any], resolve: Resolve | None) -> Any:
    """A value of one of several types; None among them allows null."""
    may_be_null = NoneType in hints
    if value is None and may_be_null:
        return None
    errors = []
    for hint in hints:
        if hint is not NoneType:
            try:
                return _value(name, value, hint, resolve)
            except ConfigError as error:
                errors.append(error)
    is_of_whole = str(errors[0]).startswith(f"{name}={value}: ")
    raise ConfigError(f"{errors[0]} or null") if may_be_null and is_of_whole else errors[0]


def _pairs(name: str, value: Any, is_table: bool) -> Iterable[tuple[Any, Any]]:
    """The pairs (key, value) of a table, or unless `is_table` of the list that `written` makes."""
    if isinstance(value, Mapping):
        return value.items()
    if is_table or not (
        _is_list(value) and all(_is_list(pair) and len(pair) == 2 for pair in value)
    ):
        raise refused(name, value, "a table")
    return value  # type: ignore[no-any-return]  # checked just now


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str)


def _items(name: str, value: Any, hints: Sequence[Any], resolve: Resolve | None) -> Any:
    """The items of a list, all of one type, or each of its own as in tuple[int, str]."""
    if not _is_list(value):
        raise refused(name, value, "a list")
    first_hint, *further_hints = hints
    if further_hints in ([], [...]):
        hints = [first_hint] * len(value)
    elif len(hints) != len(value):
        raise refused(name, value, f"a list of {len(hints)}")
    pairs = enumerate(zip(value, hints, strict=True))
    return tuple(_value(f"{name}[{i}]", item, hint, resolve) for i, (item, hint) in pairs)


def _object(name: str, value: Any, hint: Any, resolve: Resolve | None) -> Any:
    """What a setting stands for: any object, or one of a dataclass, filled if it is a table."""
    if resolve:
        value = resolve(hint, value)
    if hint is Any or isinstance(value, hint):
        return value
    if resolve and isinstance(value, Mapping):
        return filled(hint, value, resolve, f"{name}.")
    raise refused(name, value, f"a table of the settings of {hint.__name__}")
