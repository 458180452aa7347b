"""The whole report of a small study: every section, sentence and figure, and no word that a reader
would stumble over."""

import json
import re
from pathlib import Path

import pytest
from syrupy.assertion import SnapshotAssertion

from pipeline.core.errors import ArtifactError
from pipeline.report import report
from pipeline.report.study import StudyResults
from tests.report.studied import FEW, SETTINGS

SECTIONS = [
    "simulated campus",
    "Set-up: simulated campus, cells of 10 m",
    "Results by distance: simulated campus",
    "Results by cells: simulated campus",
    "Compared, headings, novelty: simulated campus",
    "Figures: simulated campus",
    "Ageing: simulated campus, 287 days after training",
    "Headings: simulated campus",
    "Construction: simulated campus",
    "Stress: simulated campus",
    "Real changes, buildings that went up or came down: simulated campus",
    "Cell sizes: simulated campus (Fig. 11)",
    "What the words mean",
]


@pytest.fixture(scope="module")
def written(study: StudyResults, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the report, beside the other artifacts."""
    folder = tmp_path_factory.mktemp("written") / "report"
    line = report.write(
        folder, study.layout, {"campus": SETTINGS}, study.table, FEW, lambda name: pytest.fail(name)
    )
    assert re.fullmatch(r"12 sections and 31 figures of 1 study; page\.html has \d\.\d MB", line)
    return folder


def test_the_report_reads_from_top_to_bottom(written: Path, snapshot: SnapshotAssertion) -> None:
    text = (written / "campus/10m/report.md").read_text()
    assert re.findall(r"^## (.*)", text, re.MULTILINE) == SECTIONS
    assert (
        text.count("**Simulated, not recorded data.**") == 13
    )  # once above all, and in each section
    prose = re.sub(r"^(\||!\[|- `|Sources).*", "", text, flags=re.MULTILINE)
    assert not re.findall(r"\bnan\b|None|\{|\}|\S  +\S| [,;.:] |\.\.|\(\)|``|−0\.000", prose)
    assert "\n\n\n\n" not in text
    assert text == snapshot


def test_bands_of_distance_are_those_that_the_results_go_by(written: Path) -> None:
    text = (written / "campus/10m/report.md").read_text()
    assert re.search(r"\| nearest change +\| +0–25 m \| +25–50 m \| +over 50 m \|", text)


def test_every_figure_is_there_and_listed(written: Path) -> None:
    folder = written / "campus/10m"
    listed = {one["file"]: one for one in json.loads((folder / report.MANIFEST).read_text())}
    shown = re.findall(r"!\[[^]]*\]\(([^)]*)\)", (folder / "report.md").read_text())
    assert set(shown) == set(listed) == {path.name for path in folder.glob("*.svg")}
    name = "outcomes_sci_2012-02-04.svg"
    assert listed[name] == {"file": name, "model": "sci", "sequence": "2012-02-04"}


def test_the_page_shows_the_best_models_figures_alone_and_every_chapter(written: Path) -> None:
    page = (written / "page.html").read_text()
    assert "sci: entropy of seen and unseen" in page
    assert "scan_context: entropy of seen and unseen" not in page
    assert all(
        f"<h3>{name}</h3>" in page
        for name in ("Headings: simulated campus", "Stress: simulated campus")
    )


def test_without_studies_there_is_nothing_to_report(study: StudyResults, tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match="nothing to report yet"):
        report.write(tmp_path, study.layout, {}, study.table, FEW, lambda name: pytest.fail(name))


def test_a_terminal_shows_the_main_numbers_and_where_the_report_lies(
    study: StudyResults, written: Path, snapshot: SnapshotAssertion
) -> None:
    text = report.terminal_text(study, 31)
    assert (written / "campus/10m/results.txt").read_text() == text + "\n"
    assert re.sub(r"\S*/artifacts/", "artifacts/", text) == snapshot
    assert not re.search("[`*]|nan", text)
    assert max(map(len, text.splitlines())) <= 160
