"""Builds objects from settings: a mapping of a yaml or a site file in; an object of a class out.

The key `_target_` names the class, such as pipeline.views.scan_context.ScanContext, and the other
keys are its fields. Settings may come from a stranger's file, so only dataclasses of named parts of
this project are built.
"""

import ast
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import fields, is_dataclass
from importlib import import_module
from typing import Any

from pipeline.core.errors import ConfigError, NotInstalledError

TARGET = "_target_"
"""The key with the full name of a class; Hydra calls it so, which builds objects of conf/."""


def build(settings: Any, roots: tuple[str, ...]) -> Any:
    """Build the object that `settings` describe; objects nested in its fields are built first.

    `roots` are the allowed beginnings of a class's name, such as `pipeline.views.`, with the dot.
    Settings without `_target_` are returned as they are, with what is nested in them built. Keys
    that the class has no field for are ignored. Raises ConfigError for a class that is not allowed.
    """
    if isinstance(settings, list):
        return [build(item, roots) for item in settings]
    if not isinstance(settings, Mapping):
        return settings
    values = {name: build(value, roots) for name, value in settings.items()}
    if TARGET not in values:
        return values
    cls = target_class(str(values[TARGET]), roots)
    names = [field.name for field in fields(cls) if field.init]
    return cls(**{name: values[name] for name in names if name in values})


def target_class(target: str, roots: tuple[str, ...]) -> type[Any]:
    """Import the dataclass named `target`; its module must lie below one of `roots`.

    Raises ConfigError for any other class, NotInstalledError if its module needs a missing package.
    """
    module, _, name = target.rpartition(".")
    cls = None
    if module.startswith(roots) and name.isidentifier():
        try:
            cls = getattr(import_module(module), name, None)
        except ImportError as error:
            if error.name and not error.name.startswith("pipeline"):
                reason = f"{error.name}: not installed, and {module} needs it"
                raise NotInstalledError(f"{reason}; `pip install 'yearloc[site]'`") from None
    if not (isinstance(cls, type) and is_dataclass(cls) and cls.__module__ == module):
        raise ConfigError(
            f"{TARGET}={target}: expected a class of "
            f"{' or '.join(root.rstrip('.') for root in roots)}"
        )
    return cls


def target_of(instance: object) -> str:
    """The `_target_` from which the object can be built: the full name of its class."""
    return f"{type(instance).__module__}.{type(instance).__name__}"


def parsed(text: object) -> Any:
    """Parse a text of a model's recipe: `0.002` is a number, `True` a bool, `jet` a string."""
    with suppress(ValueError, SyntaxError):
        return ast.literal_eval(str(text))
    return text
