"""A section of the report, kept and told."""

from pathlib import Path

import pytest

from pipeline.errors import ArtifactError
from pipeline.reports.section import Section, Shown
from pipeline.reports.table import Table

SECTION = Section(
    "campus-10m-turned",
    "Headings",
    "What if the robot is turned?",
    ("It is lost.", "For good."),
    True,
    (Shown("turned.svg", "Turned", "Read it so.", "It falls."),),
    (("Numbers", Table(("model", "AUC"), (("sci", "0.5"),), words=1)),),
    ("artifacts/robustness/campus/10m/turned",),
    {"seeds": 3},
)


def test_a_section_comes_back_as_it_was_written(tmp_path: Path) -> None:
    SECTION.write(tmp_path)
    assert Section.read(tmp_path) == SECTION


def test_its_page_says_question_answer_and_that_it_is_simulated(tmp_path: Path) -> None:
    SECTION.write(tmp_path)
    page = (tmp_path / "campus-10m-turned.md").read_text()
    parts = (
        "# Headings",
        "Simulated data.",
        "What if",
        "It is lost.\n\n- For good.",
        "![Turned](turned.svg)",
        "Read it so. It falls.",
        "0.5",
    )
    places = [page.index(part) for part in parts]
    assert places == sorted(places)


@pytest.mark.parametrize("text", [None, "{", '{"name": "x"}', '{"figures": [], "tables": [], "answer": "once a string"}'])
def test_a_folder_without_one_is_named(tmp_path: Path, text: str | None) -> None:
    if text is not None:
        (tmp_path / "section.json").write_text(text)
    with pytest.raises(ArtifactError, match=r"section\.json: no section of a report .*`dvc repro` makes it"):
        Section.read(tmp_path)
