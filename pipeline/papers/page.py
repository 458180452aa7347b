"""docs/papers.md: what the two papers found, and what the kept tables of results show."""

from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import yaml

from pipeline.core.replacing import replace
from pipeline.papers.claims import CLAIMS, Claim
from pipeline.papers.kept import FOLDER, Kept, read
from pipeline.papers.rules import UNTRAINED, Estimate, Outcome, Side
from pipeline.report.comparison import ONE_SEED
from pipeline.report.render import filled
from pipeline.report.table import bracket, fixed, signed

PAGE = Path("docs/papers.md")


@cache
def words() -> Mapping[str, Any]:
    """The words of the page, templates/words.yaml."""
    entries: Mapping[str, Any] = yaml.safe_load(_part("words.yaml"))
    return entries


def page(kept: Kept) -> str:
    """The whole page."""
    papers = [
        {
            "title": title,
            "rows": [_row(kept, claim) for claim in CLAIMS if claim.paper == number],
        }
        for number, title in words()["papers"].items()
    ]
    headlines = [row["headline"] for paper in papers for row in paper["rows"] if row["headline"]]
    origins = [{"name": name, "use": "", **origin} for name, origin in kept.origins.items()]
    for origin in origins:
        origin["budgets"] = ", ".join(
            f"{name} `{study['budget']}`" for name, study in origin["studies"].items()
        )
    values = {"papers": papers, "headlines": headlines, "origins": origins, "one_seed": ONE_SEED}
    return f"{filled(_part('page.md.j2'), **values)}\n"


def write(folder: Path = FOLDER, path: Path = PAGE) -> None:
    """Write the page of the tables that are kept in a folder."""
    with replace(path) as scratch:
        scratch.write_text(page(read(folder)), encoding="utf-8")


def _part(name: str) -> str:
    """The text of a file in templates/."""
    return files("pipeline.papers").joinpath("templates", name).read_text(encoding="utf-8")


def _row(kept: Kept, claim: Claim) -> dict[str, Any]:
    """The texts of a finding."""
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
    if not outcome.sides:
        return "–"
    sides = [side for side, _ in outcome.sides]
    is_clear = len({side.label for side in sides}) == len(sides)
    is_one_study = len({side.study for side in sides}) == 1
    places = [f"`{side.table}`" if is_one_study else side.study for side in sides]
    texts = [
        f"{side.label} {number}" if is_clear else f"{side.label} of {place} {number}"
        for side, place, number in zip(sides, places, numbers, strict=True)
    ]
    is_trained = any(side.method not in UNTRAINED for side, _ in outcome.sides)
    seeds = f"{outcome.seeds} seed{'s' * (outcome.seeds != 1)}"
    return f"{', '.join(texts)}; {seeds if is_trained else 'nothing is trained'}"


def _data(kept: Kept, outcome: Outcome) -> str:
    """On which data: recorded or simulated, and in which table."""
    places: dict[str, list[str]] = {}
    for side, _ in outcome.sides:
        source = "simulated" if kept.simulated(side.table, side.study) else "recorded"
        tables = places.setdefault(f"{side.study}, {source}", [])
        tables += [] if f"`{side.table}`" in tables else [f"`{side.table}`"]
    texts = [f"{place}: {', '.join(tables)}" for place, tables in places.items()]
    return "; ".join(texts) or words()["no_data"]


def _lacking(kept: Kept, outcome: Outcome) -> str:
    """Which tables and models are missing, and how to get them."""
    tables: dict[str, list[Side]] = {}
    for side in outcome.missing:
        tables.setdefault(side.table, []).append(side)
    texts = []
    for name, sides in tables.items():
        if name in kept.frames:
            labels = dict.fromkeys(f"{side.number} of `{side.model}`" for side in sides)
            texts.append(f"`{name}` has no {', no '.join(labels)}")
        else:
            texts.append(f"no table `{name}` is kept: {words()['tables'][name]}")
    return "; ".join(texts)


def _number(estimate: Estimate, digits: int, is_difference: bool = False) -> str:
    value = (signed if is_difference else fixed)(estimate.value, digits)
    return " ".join(filter(None, (value, bracket((estimate.low, estimate.high), digits))))
