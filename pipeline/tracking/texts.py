"""The texts of MLflow's page, from templates: an experiment's note, a run's description."""

from functools import cache
from importlib.resources import files
from string import Template
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined


def part(name: str) -> str:
    """The text of a file in templates/."""
    return files("pipeline.tracking").joinpath("templates", name).read_text(encoding="utf-8")


def filled(name: str, **values: Any) -> str:
    """A filled template; its `$page` waits for `linked`."""
    return _environment().get_template(name).render(**values)


def linked(text: str, address: str) -> str:
    """A text with `$page` replaced by the address of the experiment's charts.

    Only the database knows that address.
    """
    return Template(text).safe_substitute(page=address)


@cache
def _environment() -> Environment:
    loader = PackageLoader("pipeline.tracking", "templates")
    return Environment(loader=loader, undefined=StrictUndefined, autoescape=False)
