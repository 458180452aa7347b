"""Builds objects from a yaml or a file.

`_target_` names a class of this project, the other keys are its fields.
"""

import ast
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any

from pipeline.core.errors import ConfigError, NotInstalledError

TARGET = "_target_"


def build(spec: Any, roots: tuple[str, ...]) -> Any:
    """Build the object of a mapping with `_target_`; mappings and lists within it are built first.

    Only dataclasses of modules below `roots`, such as pipeline.views., are made: a file may come
    from anywhere. Keys that the class has no field for are left out. Raises ConfigError for any
    other class.
    """
    if isinstance(spec, list):
        return [build(item, roots) for item in spec]
    if not isinstance(spec, Mapping):
        return spec
    values = {name: build(value, roots) for name, value in spec.items()}
    if TARGET not in values:
        return values
    kind = target_class(str(values[TARGET]), roots)
    return kind(
        **{
            field.name: values[field.name]
            for field in fields(kind)
            if field.init and field.name in values
        }
    )


def target_class(target: str, roots: tuple[str, ...]) -> type[Any]:
    """The dataclass named `target`, of a module below `roots`; raises ConfigError for any other."""
    module, _, name = target.rpartition(".")
    kind = None
    if module.startswith(roots) and name.isidentifier():
        try:
            kind = getattr(import_module(module), name, None)
        except ImportError as error:
            if error.name and not error.name.startswith("pipeline"):
                reason = f"{error.name}: not installed, and {module} needs it"
                raise NotInstalledError(f"{reason}; `pip install 'yearloc[site]'`") from None
    if not (isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == module):
        raise ConfigError(
            f"{TARGET}={target}: expected a class of "
            f"{' or '.join(root.rstrip('.') for root in roots)}"
        )
    return kind


def target_of(built: object) -> str:
    """The `_target_` of an object that was built: its class, as `target_class` expects it."""
    return f"{type(built).__module__}.{type(built).__name__}"


def plain(text: object) -> Any:
    """Parse a value of a model's recipe: `0.002` a number, `True` a switch, `jet` a word."""
    with suppress(ValueError, SyntaxError):
        return ast.literal_eval(str(text))
    return text
