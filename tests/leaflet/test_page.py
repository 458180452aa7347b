"""The page of a small study: what it tells, what it says is missing, and that a browser works it offline."""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

from pipeline.errors import ArtifactError
from pipeline.leaflet.page import Leaflet
from tests.leaflet.made import EVIL, STUDIES, build, drawn_and_told, leaflet

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))), None)
LISTEN = """<script>
window.faults = [];
addEventListener("error", (event) => faults.push(event.message));
addEventListener("unhandledrejection", (event) => faults.push(String(event.reason)));
document.addEventListener("securitypolicyviolation", (event) => faults.push(event.blockedURI));
</script>"""
WORK = """<script>
addEventListener("load", () => {
  const get = (name) => document.getElementById(`map-${name}`);
  const rows = (table) => [...table.tBodies[0].rows, ...table.tFoot.rows].map((row) => row.cells[0].textContent);
  const table = document.querySelector("#campus-10m-turned table"), head = table.tHead.rows[0].cells[1];
  const sorted = [1, 2, 3].map(() => { head.firstElementChild.click(); return [head.getAttribute("aria-sort"), rows(table)]; });
  const words = (parent) => [...parent.children].map((one) => one.textContent);
  const told = () => Object.fromEntries([...document.querySelectorAll("#map-told dl div")].map(words));
  const legend = () => words(get("legend"));
  const before = legend();
  get("next").click();
  const first = told();
  get("wrong").click();
  const wrong = [document.querySelector("#map-told h3").textContent, told()];
  get("by").value = "cells";
  get("by").dispatchEvent(new Event("change"));
  const cells = legend();
  get("canvas").dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
  const back = document.querySelector("#map-told h3").textContent;
  setTimeout(() => {
    const seen = (image) => new Set(image.getContext("2d").getImageData(0, 0, 120, 40).data).size;
    const views = [...document.querySelectorAll("#map-views canvas")].map(seen);
    document.title = JSON.stringify({ faults, evil: window.evil, sorted, before, first, wrong, cells, back, views,
      wide: document.documentElement.scrollWidth - innerWidth });
  }, 300);
});
</script>"""


@pytest.fixture(scope="module")
def artifacts(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = build(tmp_path_factory.mktemp("built") / "artifacts")
    drawn_and_told(root)
    return root


@pytest.fixture(scope="module")
def page(artifacts: Path) -> str:
    return leaflet(artifacts).html()


def test_the_page_answers_in_numbers(page: str) -> None:
    # sci is right within 12 m at 4 of the 5 seen queries, by cells at 3; given a tenth of its training
    told = " ".join(re.sub(r"<[^>]+>", "", page.partition('class="answer"')[2].partition("</p>")[0]).split())
    assert "sci (given 10 % of its full training) answers with a place within 12 m for 80 % of the queries" in told
    assert "the very cell of 10 m for 60 %" in told
    assert "after 20 days to 80 %" in told
    assert "Next is m2dp with" in told


def test_the_page_asks_nothing_of_the_network(page: str) -> None:
    assert "default-src 'none'" in page
    assert re.findall(r'(?:src|srcset|data-src)="(?!data:)[^"]*"', page) == []
    assert not re.search(r"@import|url\(|fetch\(|XMLHttpRequest|<link(?! rel=\"icon\" href=\"data:,\")", page)
    assert set(re.findall(r'href="(\w+:[^"]*)"', page)) == {
        "data:,",
        "https://doi.org/10.1109/LRA.2019.2897340",
        "https://doi.org/10.1109/IROS.2018.8593562",
    }


def test_every_link_within_the_page_leads_somewhere_once(page: str) -> None:
    names = re.findall(r'\sid="([^"]+)"', page)
    assert len(names) == len(set(names))
    assert set(re.findall(r'href="#([^"]*)"', page)) <= set(names)


def test_each_number_leads_to_its_artifact(page: str) -> None:
    assert 'href="#at-artifacts-evaluate-campus-10m-sci-2012-02-04-zarr"><span class="number"><span>0.800' in page
    assert "<dt>epochs</dt><dd>2</dd>" in page


def test_simulated_data_are_called_so_and_text_stays_text(page: str) -> None:
    assert "Simulated, not recorded data" in page
    assert EVIL not in page
    assert "a &lt;/script&gt;&lt;script&gt;" in page


def test_a_section_shows_its_first_table_and_folds_the_others(page: str) -> None:
    section = page.partition('id="campus-10m-turned"')[2].partition("</section>")[0]
    first, fold, others = section.partition("Further tables")
    assert fold
    assert "AUC by <code>case</code>" in first
    assert "AUROC by <code>case</code>" in others
    assert first.count("<li>") == 1  # the second finding


def test_what_is_not_there_is_said(artifacts: Path, page: str, tmp_path: Path) -> None:
    missing = page.partition("What is not in this page")[2]
    assert "no section on how methods age; <code>make studies</code> builds it" in missing
    assert "recall_at.svg: no such figure" in missing
    shutil.copytree(artifacts, tmp_path / "artifacts")
    broken = tmp_path / "artifacts/robustness/campus/10m/broken"
    broken.mkdir()
    (broken / "section.json").write_text("{}")
    shutil.copytree(broken.parent / "turned", broken.parent / "asked_no_more")
    twice = {**STUDIES, "town": {**STUDIES["campus"], "train": "x"}, "suburb": {"question": "viewpoints"}}
    told = Leaflet.gather(tmp_path / "artifacts", twice, "5m", Path("none"))
    assert len(told.chapters) == len(told.sections) == 1
    assert any("town/10m/sci.safetensors: no such model" in line for line in told.missing)
    assert any("broken/section.json: no section" in line for line in told.missing)
    assert any(line.startswith("suburb asks about viewpoints alone") for line in told.missing)
    with pytest.raises(ArtifactError, match="nothing to tell of yet; `dvc repro` builds the studies"):
        leaflet(tmp_path / "empty")


def test_the_page_is_the_same_each_time(artifacts: Path, page: str) -> None:
    assert leaflet(artifacts).html() == page


@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
def test_a_browser_sorts_tables_and_shows_a_query_beside_its_match(page: str, tmp_path: Path) -> None:
    told = worked(page, tmp_path)
    assert told["faults"] == []
    assert "evil" not in told
    assert told["sorted"] == [
        ["descending", ["late", "sci", "m2dp", "mean"]],
        ["ascending", ["sci", "late", "m2dp", "mean"]],
        [None, ["sci", "m2dp", "late", "mean"]],
    ]
    assert told["before"] == ["right 4", "wrong 1", "unseen 2", "training path"]
    assert told["first"]["Outcome"] == "right: within 12 m"
    assert told["first"]["Error"] == "1.0 m from query to answer"
    assert told["first"]["Novelty"] == "0.100 (entropy); accepted: threshold 0.500"
    assert told["wrong"][0] == "Query 3 of 7"
    assert told["wrong"][1]["Error"] == "200 m from query to answer"
    assert told["cells"] == ["hit 2", "miss 1", "false alarm 3", "correct rejection 1", "training path"]
    assert told["back"] == "Query 2 of 7"
    assert len(told["views"]) == 2
    assert min(told["views"]) > 50  # many colours
    assert told["wide"] <= 0


def worked(page: str, folder: Path) -> Any:
    """What a script that clicks through a copy of the page puts into its title."""
    copy = folder / "page.html"
    copy.write_text(page.replace("<head>", f"<head>{LISTEN}", 1).replace("</body>", f"{WORK}</body>"), encoding="utf-8")
    quiet = ("--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking")
    own = (f"--user-data-dir={folder / 'profile'}", "--disable-sync", "--disable-component-update", "--window-size=600,900")
    asked = [str(BROWSER), *quiet, *own, "--virtual-time-budget=5000", "--dump-dom", copy.as_uri()]
    shown = subprocess.run(asked, capture_output=True, text=True, timeout=120, check=True).stdout
    title = re.search("<title>(.*?)</title>", shown, re.DOTALL)
    assert title
    return json.loads(title[1].replace("&lt;", "<").replace("&gt;", ">").replace("&amp;", "&"))
