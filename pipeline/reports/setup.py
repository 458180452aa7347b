"""The methods of a study, and what each was given to learn with."""

from collections.abc import Mapping
from textwrap import shorten
from typing import TYPE_CHECKING

from pipeline.reports.table import MISSING, Table
from pipeline.studies import catalogue

if TYPE_CHECKING:
    from pipeline.reports.learned import Learned

LONGEST = 78
"""Characters of a description in a terminal."""


def table(models: Mapping[str, "Learned"], longest: int = LONGEST) -> Table:
    """A row a method: what it is, what it looks at, how much of its own full training it had, and what it keeps of that."""
    rows = []
    for method, model in models.items():
        what = catalogue.what(model.recipe.get("_target_", ""))
        budget, trained = MISSING, "nothing"
        if model.rounds:
            kept = "" if model.best_round is None else f", no. {model.best_round + 1} kept"
            budget, trained = model.recipe.get("budget", MISSING), f"{model.rounds} rounds{kept}"
        what = shorten(what, longest, placeholder=" …") or MISSING
        rows.append((method, what, model.recipe.get("view", MISSING), budget, trained, f"{model.megabytes:.1f}"))
    return Table(("method", "what it is", "looks at", "budget", "trained", "model [MB]"), tuple(rows), words=5)


def settings(models: Mapping[str, "Learned"]) -> list[str]:
    """A line a method: every parameter that it was learned with."""
    told = {
        method: ", ".join(f"{name} {value}" for name, value in model.recipe.items() if not name.startswith("_"))
        for method, model in models.items()
    }
    return [f"`{method}`: {parameters}" for method, parameters in told.items() if parameters]
