"""The page of a small study: what it shows, what it says is missing, and that it works in a browser
without a network."""

import json
import re
import shutil
import subprocess
from base64 import b64decode
from collections.abc import Iterator
from dataclasses import replace
from html import unescape
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from pipeline.report import render
from pipeline.report.alignment import best_shift, best_shifts, spectra
from pipeline.report.result import PRECISIONS, coverage
from pipeline.report.study import StudyResults
from pipeline.report.web.front import front, rivals
from pipeline.report.web.map import COLUMNS, LEVELS, Views, chart, indices, quantized, sheet
from pipeline.report.web.page import Entry, Picture, html
from pipeline.views.scan_context import quantize
from tests.report.site import EVIL, LOCK, SVG, TESTS, WORDS, XY_M, build, entries, heights, sections
from tests.studies.made import study as made_study

BROWSER = next(
    filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome", "chrome"))),
    None,
)
LISTEN = """<script>
window.faults = [];
const listen = (kind, say) => addEventListener(kind, (event) => faults.push(say(event)));
listen("error", (event) => event.message);
listen("unhandledrejection", (event) => String(event.reason));
listen("securitypolicyviolation", (event) => event.blockedURI);
console.error = console.warn = (...words) => faults.push(words.join(" "));
</script>"""
WORK = """<script>
const run = () => {
  const get = (name) => document.getElementById(`map-${name}`), canvas = get("canvas"), shown = { faults, evil: window.evil };
  document.querySelector("#campus-10m-turned").open = true;
  const words = (parent) => [...parent.children].map((one) => one.textContent);
  const query = () => [...get("query").querySelectorAll("h3, dd")].map((one) => one.textContent);
  const table = document.querySelector("#campus-10m-turned table");
  const rows = () => [...table.tBodies[0].rows, ...table.tFoot.rows].map((row) => row.cells[0].textContent.trim());
  const head = table.tHead.rows[0].cells[1];
  for (let n = 0; n < 3; n++) { head.firstElementChild.click(); shown[head.getAttribute("aria-sort")] = rows(); }
  shown.accepted = words(get("legend"));
  shown.opened = [...query().slice(0, 3), words(get("scans"))[0]];
  get("by").value = "distance";
  get("by").dispatchEvent(new Event("change"));
  const box = canvas.getBoundingClientRect(), { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  const isRed = (_, i) => data[4 * i] === 200 && data[4 * i + 1] === 64 && data[4 * i + 2] === 10; // of wrong answers
  const red = [...Array(data.length / 4).keys()].filter(isRed), middle = red[Math.floor(red.length / 2)] || 0;
  const [x, y] = [box.left + 1 + middle % canvas.width, box.top + 1 + middle / canvas.width];
  const at = { clientX: x, clientY: y, bubbles: true, cancelable: true };
  const wheel = () => !canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -300, ...at }));
  Object.assign(shown, { red: red.length, "by distance": words(get("legend")) });
  get("next").click();
  shown.first = query().slice(1, 4);
  get("wrong").click();
  shown.wrong = query().slice(0, 3);
  canvas.dispatchEvent(new MouseEvent("click", at));
  shown.picked = query()[0];
  const scrolled = wheel(), before = canvas.toDataURL();
  canvas.focus();
  shown.zoomed = [scrolled, wheel(), canvas.toDataURL() !== before];
  get("by").value = "cells";
  get("by").dispatchEvent(new Event("change"));
  shown["by cells"] = words(get("legend"));
  canvas.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowLeft" }));
  shown.back = query()[0];
  get("wrong").click();
  setTimeout(() => {
    const views = [...get("views").querySelectorAll("canvas")].map((view) => view.getContext("2d").getImageData(0, 0, 120, 40));
    shown.colours = views.map((view) => new Set(view.data).size);
    shown.overflow = document.documentElement.scrollWidth - document.documentElement.clientWidth;
    document.title = JSON.stringify(shown);
  }, 300);
};
const wait = () => document.getElementById("map-query").textContent ? run() : setTimeout(wait, 20);
addEventListener("load", wait);
</script>"""


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Iterator[StudyResults]:
    """The study; the words are the page's own and some for the study."""
    own = yaml.safe_load(render.part("words.yaml"))
    words = own | {group: own[group] | texts for group, texts in WORDS.items()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(render, "_words", lambda: words)
        yield build(tmp_path_factory.mktemp("page") / "artifacts")


@pytest.fixture
def given(built: StudyResults) -> StudyResults:
    """The study without what others have read of it."""
    return replace(built)


@pytest.fixture(scope="module")
def page(built: StudyResults) -> str:
    return html(entries(built), LOCK)


def test_the_page_asks_nothing_of_the_network(page: str) -> None:
    assert "default-src 'none'" in page
    assert re.findall(r'(?:src|srcset|data-src)="(?!data:)[^"]*"', page) == []
    assert not re.search(
        r"@import|url\(|fetch\(|XMLHttpRequest|<link(?! rel=\"icon\" href=\"data:,\")", page
    )
    papers = {
        "https://doi.org/10.1109/LRA.2019.2897340",
        "https://doi.org/10.1109/IROS.2018.8593562",
    }
    assert set(re.findall(r'href="(\w+:[^"]*)"', page)) == {"data:,", *papers}


def test_every_link_within_the_page_leads_somewhere_once(page: str) -> None:
    names = re.findall(r'\sid="([^"]+)"', page)
    assert len(names) == len(set(names))
    assert set(re.findall(r'href="#([^"]*)"', page)) <= set(names)
    assert (
        '<a href="#campus-10m">campus <small>simulated</small></a>' in page.partition("</nav>")[0]
    )


def test_captions_lead_to_sources_and_models_to_their_recipe(page: str) -> None:
    cell = '<span class="number"><span>0.810</span><b class="mark">+</b><small>[.70, .90]</small></span>'
    assert f'data-key="0.81">{cell}' in page
    assert (
        '<p class="caption">AUC by <code>case</code> <a href="#campus-10m-turned-source">Source</a></p>'
        in page
    )
    assert page.count('href="#campus-10m-turned-source"') == 2  # one link a table, none a number
    assert re.search(
        r'train/campus/10m/sci\.zarr\.zip</code>.*md5 <code>0a1b</code> by <a href="#stage-train-campus">',
        page,
    )
    shown = (
        "<dt>n_way</dt><dd>1</dd>",
        "seed: 7",
        "40 resamples",
        "<dt>trained with</dt><dd>sci 1, 2</dd>",
    )
    assert all(part in page for part in shown)
    assert not any(part in page for part in ("_target_", "conf/lists.yaml"))


def test_simulated_data_are_called_so_and_text_stays_text(page: str) -> None:
    assert (
        page.count('<p class="banner">Simulated, not recorded data</p>') == 3
    )  # the first screen, the set-up and the study
    assert EVIL not in page
    assert page.count("a &lt;/script&gt;&lt;script&gt;") >= 4
    assert "late &lt;b&gt;" in page


def test_the_first_screen_answers_before_all_else(page: str) -> None:
    first, _, below = page.partition("Every method, every day")
    assert "<h1>Learned in one day. Still right after 152\N{NO-BREAK SPACE}days?</h1>" in first
    accepted, recall = re.findall(r'<section class="card.*?</section>', first, re.DOTALL)
    assert [re.sub("<.*?>", "", one) for one in re.findall(r'<p class="big">(.*?)</p>', first)] == [
        "10 answers, 5 of them wrong",
        "80\N{NO-BREAK SPACE}% → 60\N{NO-BREAK SPACE}%",
    ]
    assert re.findall(r'data-key="(\d)"', accepted) == [*"521", *"531"]  # day by day
    assert "2 wrong answers were refused." in accepted
    assert "<code>m2dp</code>: 40\N{NO-BREAK SPACE}% → 20\N{NO-BREAK SPACE}%" in recall
    assert below.index('data-model="sci" data-day="2012-06-15"') < below.index(
        'data-model="m2dp" data-day="2012-02-04"'
    )
    shown = below.partition("All tables and figures")
    folded = re.findall("<summary>(.*?)</summary>", shown[0].partition("</article>")[0])
    assert folded == ["<h3>What these numbers do not say (4)</h3>"]  # and no method
    assert shown[2].count('<details class="chapter"') == 4  # the set-up, the study, words, sources
    assert (
        "Training was cut short: <code>sci</code> had 3\N{NO-BREAK SPACE}% of its own full "
        "training." in below
    )
    turned = re.search(r"Turned, rebuilt, older.*?<tbody>(.*?)</tbody>", below, re.DOTALL)
    assert turned
    # by cells, in which ageing is measured, the answer that is lost was in the next cell already
    assert re.findall(r'data-key="([\d.]+)"', turned[1]) == ["0.8", "0.6", "0", "0.4", "0.2", "0"]


def test_a_method_trained_too_little_is_folded_away_with_the_reason(given: StudyResults) -> None:
    vars(given)["cut_short"] = {"m2dp": 0.05}
    shown = html([Entry(given, [], front(given))], LOCK)
    first, _, below = shown.partition("Every method, every day")
    assert "<code>m2dp</code> had 5\N{NO-BREAK SPACE}% of its own full training" in first
    assert "No baseline had its full training." in first
    assert '"m2dp, 2012-06-15' not in first
    compared, _, folded = below.partition("Trained too little to be compared: <code>m2dp</code>")
    assert 'data-model="m2dp"' not in compared
    assert 'data-model="m2dp"' in folded


@pytest.mark.parametrize(
    ("posed", "best", "expected"),
    [
        ([], "sci_ring", ("sci_ring", "m2dp")),  # sci is of the same family
        (["sci_ring"], "sci_ring-pose", ("sci_ring", "m2dp")),  # no baseline has poses
        (["sci_ring", "scan_context"], "sci_ring-pose", ("sci_ring-pose", "scan_context-pose")),
        (["sci_ring", "m2dp-hi"], "sci_ring-pose", ("sci_ring-pose", "m2dp-hi-pose")),
    ],
)
def test_the_best_model_is_set_against_a_baseline_with_the_same_kind_of_answers(
    posed: list[str], best: str, expected: tuple[str, str]
) -> None:
    methods = ["sci", "sci_ring", "scan_context"]
    m2dp = {"name": "m2dp", "view": "signature", "variants": {"hi": "method.resolution=2"}}
    settings = made_study(methods=[*methods, m2dp], poses=posed)
    # of the models without poses, m2dp is right more often than scan_context
    compared = ["sci_ring-pose", "m2dp-hi-pose", "scan_context-pose"]
    compared += ["sci_ring", "sci", "m2dp-hi", "m2dp", "scan_context"]
    names = [answerer.name for answerer in settings.answerers]
    assert rivals(settings, best, [name for name in compared if name in names]) == expected


def test_the_first_screen_says_where_poses_are_left_out(given: StudyResults) -> None:
    one = front(given)
    with_poses = [replace(result, model="sci-pose") for result in one["best"]]
    text = render.words("front", "recall", **{**one, "best": with_poses, "one": one})
    assert "Baselines have no poses, so `sci` is compared: 80 % → 60 %." in text
    assert "The best baseline, `m2dp`: 40 % → 20 %." in text


def test_a_study_that_changed_since_it_was_measured_is_named(given: StudyResults) -> None:
    says = "was changed in conf/studies.yaml after it was measured"
    assert says in html(entries(given), LOCK, ["campus"])
    assert says not in html(entries(given), LOCK, ["town"])


def test_coverage_counts_what_can_be_answered_at_a_precision() -> None:
    novelty = np.array([0.1, 0.2, 0.2, 0.9])
    right = np.array([True, True, False, False])
    shares = dict(zip(PRECISIONS, coverage(novelty, right), strict=True))
    assert (shares[0.5], shares[0.66], shares[0.67], shares[1.0]) == (
        1.0,
        0.75,
        0.25,
        0.25,
    )  # equal novelties go together
    assert set(coverage(novelty, np.zeros(4, bool))) == {0.0}


def test_a_dot_of_a_chart_names_its_result_and_opens_it(page: str) -> None:
    """The same days have a dot in the other chart, whose ids are its own."""
    first = page.partition("Every method, every day")[0]
    dot = '<g id="campus-10m-year-sci-2012-06-15" data-model="sci" data-day="2012-06-15">'
    assert f"{dot}<title>sci, 2012-06-15, +152 d: 60 % right</title>" in first
    assert first.count('<g id="campus-10m-year-') == 4  # of two models on two days
    assert (
        "<title>sci, at its own threshold: answers 71.4 % of the queries, 40 % of them right; on"
        in page
    )


def test_the_page_shows_what_it_is_given_and_says_what_is_missing(
    given: StudyResults, page: str
) -> None:
    missing = page.partition("About this page")[2]
    assert "lost.svg: no such figure; <code>dvc repro</code> draws it" in missing
    # the figures of the other section still lie in the folder
    fewer = html([Entry(given, sections(given.layout.root)[:1])], LOCK)
    assert "Turned" not in fewer
    assert "no such figure" not in fewer
    assert "There is no study to show." in html([], LOCK)
    assert html(entries(given), LOCK) == page


def test_a_section_as_markdown(given: StudyResults) -> None:
    root = given.layout.root
    section = sections(root)[1]
    text = render.template("section.md.j2", section=section, simulated=True, folder=root)
    head = "# Turned <headings>\n\n**Simulated, not recorded data.**\n\nDoes it *matter*?"
    assert text.startswith(f"{head}\n\n{EVIL}\n\n- {EVIL}\n\n## How")
    assert (
        f"## How turned\n\n![How turned](turned.svg)\n\nRead it so. {EVIL}\n\n## How turned\n"
        in text
    )
    assert f"## AUC by `case`\n\n{section.tables[0].markdown()}\n## AUROC by" in text
    assert text.endswith("\n\nSources: `artifacts/turned.zarr`\n")


def test_a_figure_is_an_image_of_its_own() -> None:
    one = Picture.of(SVG + "\n%é")
    assert one.wide_px == 115  # 72 pt are 96 px, shown at 1.2 times that
    assert one.url.endswith("</svg> %25%C3%A9")
    assert not set('"#&') & set(one.url)


def test_a_picture_holds_every_view_as_quantized() -> None:
    images = heights(COLUMNS + 3)
    image = sheet(images)
    assert (image.mode, image.size) == ("P", (COLUMNS * 120, 80))
    assert image.getpalette()[:3] == [0, 0, 131]  # an empty bin (METHODS 2.1)
    wide = 256 // LEVELS
    for n in (0, COLUMNS - 1, COLUMNS, COLUMNS + 2):
        row, column = divmod(n, COLUMNS)
        drawn = np.asarray(image)[40 * row : 40 * row + 40, 120 * column : 120 * column + 120]
        rounded = drawn.astype(int) - quantize(images[n])
        assert (rounded.min(), rounded.max()) == (0, wide - 1)  # upwards: nothing seen is lost


def test_views_are_rolled_to_look_most_similar() -> None:
    images = heights(4)
    by = [0, 7, 60, 119]
    turned = np.stack(
        [np.roll(image, columns, axis=1) for image, columns in zip(images, by, strict=True)]
    )
    assert best_shifts(spectra(turned), spectra(images), 120).tolist() == by
    assert [best_shift(one, other) for one, other in zip(turned, images, strict=True)] == by


def unpacked(pack: dict[str, Any]) -> np.ndarray:
    """Read an array as map.js does."""
    return np.frombuffer(b64decode(pack["base64"]), f"<{pack['dtype']}") * pack.get("step", 1)


def test_numbers_are_packed_in_steps_and_none_is_the_lowest() -> None:
    pack = quantized(np.array([0.26, -1.0, np.nan]), 0.05)
    assert (pack["dtype"], unpacked(pack)[:2].tolist()) == ("i2", pytest.approx([0.25, -1.0]))
    assert unpacked(pack)[2] == pytest.approx(pack["missing"] * 0.05)
    assert quantized(np.array([1e4]), 0.05)["dtype"] == "i4"  # 200,000 steps
    assert indices(np.array([3, -1]))["dtype"] == "u2"


def moved(
    study: StudyResults, query: int, answer_xy_m: np.ndarray, path_xy_m: np.ndarray
) -> StudyResults:
    """The study with another training path, and another answer of sci to one query of day 1."""
    results = list(study.results)
    i = next(i for i, result in enumerate(results) if result.model == "sci")
    evaluation = results[i].evaluation
    answers_m = evaluation.answer_xy_m.copy()
    answers_m[query] = answer_xy_m
    results[i] = replace(results[i], evaluation=replace(evaluation, answer_xy_m=answers_m))
    vars(study).update(results=results, train_xy_m=path_xy_m)
    return study


def test_the_map_tells_training_rows_beyond_65535_apart(
    given: StudyResults, monkeypatch: pytest.MonkeyPatch
) -> None:
    # the query at x = 0 is nearest to row 69,990
    path_xy_m = np.stack([np.arange(70_000.0) - 69_990, np.zeros(70_000)], axis=1)
    monkeypatch.setattr(Views, "read", lambda *_: None)
    shown = chart(moved(given, 6, np.array([np.nan, np.nan]), path_xy_m))
    true = shown["sequences"][0]["row"]
    answered = shown["answers"]["sci"][TESTS[0]]["row"]
    positions = shown["sequences"][0]["xy"]
    first, last, xy_m = map(unpacked, (true, answered, positions))
    assert (first[0], last[-1]) == (69_990, 2**32 - 1)  # which no row has
    from_middle_m = xy_m.reshape(-1, 2) - (34_990, 0)
    assert from_middle_m == pytest.approx(XY_M)


def test_the_map_tells_apart_what_lies_as_far_out_as_utm(given: StudyResults) -> None:
    """float32 holds 4,000,000 m to a quarter of a metre; the answer lies a tenth east of the first
    pose of a path 2 m long."""
    path_xy_m = np.array([500_000.0, 4_000_000.0]) + np.array([[0.0, 0.0], [2.0, 0.0]])
    shown = chart(moved(given, 0, path_xy_m[0] + (0.1, 0.0), path_xy_m))
    packs = shown["path"], shown["answers"]["sci"][TESTS[0]]["xy"]
    path, answered = map(unpacked, packs)
    assert answered[0] - path[0] == pytest.approx(0.1, abs=0.001)


@pytest.mark.skipif(BROWSER is None, reason="no Chromium here")
def test_a_browser_sorts_tables_and_shows_a_query_beside_its_match(
    page: str, tmp_path: Path
) -> None:
    copy = tmp_path / "page.html"
    words = page.replace("<head>", f"<head>{LISTEN}", 1).replace("</body>", f"{WORK}</body>")
    copy.write_text(words, encoding="utf-8")
    flags = (
        "--headless=new",
        "--no-sandbox",
        "--disable-gpu",
        "--no-first-run",
        "--disable-background-networking",
    )
    own = (
        f"--user-data-dir={tmp_path / 'profile'}",
        "--disable-sync",
        "--window-size=390,844",
        "--virtual-time-budget=5000",
    )
    asked = [str(BROWSER), *flags, *own, "--dump-dom", copy.as_uri()]
    shown = subprocess.run(asked, capture_output=True, text=True, timeout=120, check=True).stdout
    seen = json.loads(unescape(shown.partition("<title>")[2].partition("</title>")[0]))
    assert seen.pop("red") > 10  # a right answer at the same spot does not cover the wrong one
    assert min(seen.pop("colours")) > 5  # of the query's view and of the training view beside it
    assert seen == {
        "faults": [],
        "descending": ["late <b>", "sci", "m2dp", "mean"],
        "ascending": ["sci", "late <b>", "m2dp", "mean"],
        "null": ["sci", "m2dp", "late <b>", "mean"],
        "accepted": [
            "right, accepted 2",
            "right, refused 1",
            "wrong, accepted 3",
            "wrong, refused 1",
            "training path",
        ],
        "opened": [
            "Query 5 of 7",  # the first accepted one from the middle on
            "accepted, and right: within 15 m",
            "1.0 m from query to answer",
            "Placed where the answer says, 1.0 m off (its true heading): accepted",
        ],
        "by distance": [
            "right, accepted 2",
            "right, rejected 1",
            "wrong, accepted 2",
            "unseen, accepted 1",
            "unseen, rejected 1",
            "training path",
        ],
        "by cells": [
            "right, accepted 2",
            "right, rejected 1",
            "wrong, accepted 2",
            "unseen, accepted 1",
            "unseen, rejected 1",
            "training path",
        ],
        "first": [
            "accepted, and unseen: training was never there",
            "1.0 m from query to answer",
            "0.400 (entropy); threshold 0.500",
        ],
        "wrong": [
            "Query 3 of 7",
            "accepted, and wrong: seen, but placed elsewhere",
            "200 m from query to answer",
        ],
        "picked": "Query 2 of 7",
        "zoomed": [False, True, True],  # the wheel scrolls the page until the map has the focus
        "back": "Query 1 of 7",
        "overflow": 0,
    }
