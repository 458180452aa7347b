"""Writes docs/papers.md: what the two papers found, and what the kept tables of results show.

In: the kept tables with the outcome of each finding. Out: the page, filled from
templates/page.md.j2; its words are in templates/words.yaml.
"""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from benchmarks.papers.claims import CLAIMS, Claim
from benchmarks.papers.judging import UNTRAINED, Estimate, Outcome, Side
from benchmarks.papers.kept import FOLDER, Kept, read
from pipeline.core.replacing import replace
from pipeline.report.comparison import ONE_SEED
from pipeline.report.render import filled
from pipeline.report.table import bracket, fixed, signed

PAGE = Path("docs/papers.md")


@cache
def words() -> Mapping[str, Any]:
    """The words of the page: templates/words.yaml."""
    entries: Mapping[str, Any] = yaml.safe_load(_part("words.yaml"))
    return entries


def page(kept: Kept) -> str:
    """The text of the page."""
    papers = []
    for number, title in words()["papers"].items():
        rows = [_row(kept, claim) for claim in CLAIMS if claim.paper == number]
        papers.append({"title": title, "rows": rows})
    headlines = [row["headline"] for paper in papers for row in paper["rows"] if row["headline"]]
    origins = [{"name": name, "use": "", **origin} for name, origin in kept.origins.items()]
    for origin in origins:
        origin["budgets"] = ", ".join(
            f"{name} `{study['budget']}`" for name, study in origin["studies"].items()
        )
    values = {"papers": papers, "headlines": headlines, "origins": origins, "one_seed": ONE_SEED}
    return f"{filled(_part('page.md.j2'), **values)}\n"


def write(folder: Path = FOLDER, path: Path = PAGE) -> Path:
    """Write the page from the tables that are kept in a folder; returns its path."""
    with replace(path) as scratch:
        scratch.write_text(page(read(folder)), encoding="utf-8")
    return path


def _part(name: str) -> str:
    """The text of a file in templates/."""
    return files("benchmarks.papers").joinpath("templates", name).read_text(encoding="utf-8")


def _row(kept: Kept, claim: Claim) -> dict[str, Any]:
    """The texts in the row of a finding, by the names of the template."""
    text = words()["findings"][claim.name]
    outcome = kept.outcomes[claim.name]
    reason = words()["reasons"][outcome.reason]
    values = {
        "outcome": outcome,
        "difference": _number(outcome.difference, claim.digits, is_difference=True),
        "lacking": _lacking(kept, outcome),
    }
    why = [filled(reason, **values), text.get("note", "")]
    is_headline = "headline" in text and outcome.difference.value < 0
    numbers = [_number(estimate, claim.digits) for _, estimate in outcome.sides]
    return {
        "finding": text["finding"],
        "there": text.get("there", words()["no_number"]),
        "here": _here(outcome, numbers),
        "data": _data(kept, outcome),
        "verdict": outcome.verdict,
        "why": " ".join(sentence.strip() for sentence in why if sentence),
        "headline": (
            filled(text["headline"], numbers=numbers, verdict=outcome.verdict)
            if is_headline
            else ""
        ),
    }


def _here(outcome: Outcome, numbers: list[str]) -> str:
    """Our numbers: each side with its number, and of how many seeds they are."""
    if not outcome.sides:
        return "–"
    sides = [side for side, _ in outcome.sides]
    has_unique_labels = len({side.label for side in sides}) == len(sides)
    is_one_study = len({side.study for side in sides}) == 1
    texts = []
    for side, number in zip(sides, numbers, strict=True):
        origin = f"`{side.table}`" if is_one_study else side.study
        label = side.label if has_unique_labels else f"{side.label} of {origin}"
        texts.append(f"{label} {number}")
    training = "nothing is trained"
    if any(side.method not in UNTRAINED for side in sides):
        training = f"{outcome.seeds} seed{'s' if outcome.seeds != 1 else ''}"
    return f"{', '.join(texts)}; {training}"


def _data(kept: Kept, outcome: Outcome) -> str:
    """The studies that the numbers are from, whether recorded or simulated, and their tables."""
    tables_of_study: dict[str, list[str]] = {}
    for side, _ in outcome.sides:
        source = "simulated" if kept.simulated(side.table, side.study) else "recorded"
        tables = tables_of_study.setdefault(f"{side.study}, {source}", [])
        if f"`{side.table}`" not in tables:
            tables.append(f"`{side.table}`")
    texts = [f"{study}: {', '.join(tables)}" for study, tables in tables_of_study.items()]
    return "; ".join(texts) or words()["no_data"]


def _lacking(kept: Kept, outcome: Outcome) -> str:
    """The tables and models that a verdict would need, and how to make the tables."""
    missing_of_table: dict[str, list[Side]] = {}
    for side in outcome.missing:
        missing_of_table.setdefault(side.table, []).append(side)
    texts = []
    for name, sides in missing_of_table.items():
        if name in kept.frames:
            labels = dict.fromkeys(f"{side.number} of `{side.model}`" for side in sides)
            texts.append(f"`{name}` has no {', no '.join(labels)}")
        else:
            texts.append(f"no table `{name}` is kept: {words()['tables'][name]}")
    return "; ".join(texts)


def _number(estimate: Estimate, digits: int, is_difference: bool = False) -> str:
    """A number with its interval in brackets, if it has one; a difference has its sign."""
    text = signed(estimate.value, digits) if is_difference else fixed(estimate.value, digits)
    interval = bracket((estimate.low, estimate.high), digits)
    return f"{text} {interval}" if interval else text
