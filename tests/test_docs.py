"""What the code and the pages refer to is there: sections of docs/METHODS.md, and the targets of links."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("pipeline", "stages", "conf", "benchmarks", "docs", "tests")
CITING = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*")) if path.suffix in {".py", ".yaml", ".md"}]
PAGES = [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
NUMBER = r"\d+(?:\.\d+)?"
CITATION = re.compile(rf"METHODS(?:\.md)?\s+({NUMBER}(?:(?:,| and| to)\s+{NUMBER})*)")
FENCED, CODE = re.compile(r"```.*?```", re.DOTALL), re.compile(r"`[^`\n]*`")
LINK = re.compile(r"\]\(([^)\s]+)\)")


def cited(text: str) -> list[str]:
    """Sections that a text refers to: `METHODS 7.2, 2.9` is two."""
    return [number for found in CITATION.findall(text) for number in re.findall(NUMBER, found)]


def sections(text: str) -> set[str]:
    return set(re.findall(rf"^#+ ({NUMBER})\b", text, re.MULTILINE))


def anchors(text: str) -> set[str]:
    """As GitHub makes them of headings."""
    headings = re.findall(r"^#+ (.+)$", FENCED.sub("", text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_citations_are_read_as_people_write_them() -> None:
    text = "(IROS 2018; METHODS 1.4). METHODS.md 5.4 and 5.5. Nothing but METHODS 7.2, 2.9: METHODS 6, step 4; METHODS\n4.2"
    assert cited(text) == ["1.4", "5.4", "5.5", "7.2", "2.9", "6", "4.2"]


def test_every_section_that_is_cited_exists() -> None:
    known = sections((ROOT / "docs/METHODS.md").read_text())
    assert not [(path, number) for path in CITING for number in cited(path.read_text()) if number not in known]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_to_files_and_headings(page: Path) -> None:
    for target in LINK.findall(CODE.sub("", FENCED.sub("", page.read_text()))):
        name, _, anchor = target.partition("#")
        if "://" not in target and not target.startswith("mailto:"):
            file = page.parent / name if name else page
            assert file.exists(), target
            assert not anchor or anchor in anchors(file.read_text()), target
