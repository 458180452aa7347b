"""Settings that come from a yaml or a command line, checked against the dataclass that they fill."""

import math
from dataclasses import fields
from typing import Any, Literal, get_args, get_origin, get_type_hints

from pipeline.errors import ConfigError

NAMES = {float: "a number", int: "a whole number", str: "a word", bool: "true or false"}


def check(settings: Any, group: str) -> None:
    """Raise ConfigError naming the first field of a dataclass whose value is not of its declared type.

    Plain fields only: numbers, words, switches and literals. A whole number is a number too.
    """
    hints = get_type_hints(type(settings))
    for field in fields(settings):
        hint, value = hints[field.name], getattr(settings, field.name)
        said = f"{group}.{field.name}={value}"
        if get_origin(hint) is Literal and value not in get_args(hint):
            *others, last = map(str, get_args(hint))
            raise ConfigError(f"{said}: expected {', '.join(others)} or {last}")
        if hint in NAMES and not _fits(value, hint):
            raise ConfigError(f"{said}: expected {NAMES[hint]}")


def _fits(value: Any, hint: type) -> bool:
    if hint is float:
        return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
    return isinstance(value, hint) and (hint is bool or not isinstance(value, bool))


def positive(group: str, **numbers: float) -> None:
    """Raise ConfigError naming the first number that is not above 0."""
    for name, number in numbers.items():
        if not number > 0:
            raise ConfigError(f"{group}.{name}={number}: expected a number above 0")
