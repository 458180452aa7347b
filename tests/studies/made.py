"""Makes studies for tests: a small study of the campus, with the keys that a test changes."""

from pathlib import Path
from typing import Any

from pipeline.studies.study import RECORDED as RECORDED
from pipeline.studies.study import Study

CONF = Path(__file__).parents[2] / "conf"
TABLE: dict[str, Any] = {
    "experiment": "year",
    "world": "campus_tiny",
    "source": "world",
    "reads": "simulated",
    "root": "artifacts/logs/campus",
    "train": "2012-01-15",
    "tests": ["2012-02-04"],
    "budget": "tiny",
    "submap": "single",
    "grids": ["10m"],
    "methods": ["sci"],
}


def study(name: str = "campus", **words: Any) -> Study:
    """The study of TABLE, with the values of some of its keys replaced by `words`."""
    return Study.of(CONF, name, TABLE | words)
