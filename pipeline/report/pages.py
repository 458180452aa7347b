"""The results of all studies as markdown, and the result blocks of README.md and docs/RESULTS.md.

In: the table of results. Out: `document`, which docs/RESULTS.md shows, and `scorecards`, one table
per study, which it shows for each kind of processor arithmetic. A block is the text between
`<!-- results: STUDY BUDGET KIND -->` and `<!-- end of results -->`. `blocks` lists those of a page,
`table_texts` makes texts for them, and `filled` puts them in.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import pandas as pd

from pipeline.core.errors import ConfigError
from pipeline.evaluation.numbers import LEVEL_POSES
from pipeline.evaluation.rows import pick
from pipeline.report import tables
from pipeline.report.brief import WIDEST, brief
from pipeline.report.render import template
from pipeline.report.result import Scores, ranked, read_scores
from pipeline.report.table import Table
from pipeline.report.tables import ANSWERS, KEPT, Column
from pipeline.studies.study import Study

PAGES = "README.md", "docs/index.md", "docs/RESULTS.md"
MARK = re.compile(
    r"(<!-- results: (?P<words>[^>]*?) -->\n)(?P<text>.*?)(<!-- end of results -->)", re.DOTALL
)
PICTURE = "picture"
KINDS = "brief", "tables", "bfloat16", "float32", PICTURE

# After the scorecard come these tables over the test days: protocol and number of each.
OVER_DAYS = (("cells", "recall_at_1"), ("cells", "auc_top1"), ("cells", "auroc"))
# A selection of the columns of tables.POSES.
POSES_IN_DOCUMENT = (
    Column("within 2 m, 5°", "within_2m_5deg", 3),
    Column("within 1 m, 10°", LEVEL_POSES, 3),  # of level sites alone
    Column("within .5 m, 2°", "within_05m_2deg", 3),
    Column("error [m]", "error_m", 2),
    Column("error [°]", "error_deg", 2),
    Column("accepted and right", "recall_99", 3),
    Column("wrong of accepted", "wrong_of_accepted_99", 3),
    KEPT,
)


class Block(NamedTuple):
    """The block that a mark such as `<!-- results: campus minutes brief -->` names."""

    study: str
    budget: str  # how it was trained: a file of conf/budget
    # One of KINDS: a few lines; all tables; the table as a processor of that arithmetic gives it;
    # or the moving picture.
    kind: str
    model: str = ""  # whose answers a picture shows, such as sci_ring-pose; else empty


def blocks(page: str) -> list[Block]:
    """The blocks of a page in order; raises ConfigError for a mark that cannot be read."""
    page_blocks = []
    for mark in MARK.finditer(page):
        words = mark["words"].split()
        kind = words[2] if len(words) > 2 else ""
        if kind not in KINDS or len(words) != 3 + (kind == PICTURE):
            raise ConfigError(
                f"<!-- results: {mark['words']} -->: expected STUDY BUDGET and "
                f"{', '.join(KINDS[:-1])} or {KINDS[-1]} MODEL"
            )
        page_blocks.append(Block(*words))
    return page_blocks


def filled(page: str, texts: Mapping[Block, str]) -> str:
    """The page with new texts between the marks of the given blocks; other blocks stay."""

    def text(mark: re.Match[str]) -> str:
        block = Block(*mark["words"].split())
        return f"{mark[1]}{texts[block].strip()}\n{mark[4]}" if block in texts else mark[0]

    return MARK.sub(text, page)


def table_texts(
    results: pd.DataFrame, studies: Mapping[str, Study], arithmetic: str
) -> dict[Block, str]:
    """The texts of all blocks of tables that these studies fill.

    `arithmetic` is that of the processor that they were measured on: `bfloat16` or `float32`.
    """
    texts = {}
    for name, study in studies.items():
        one_study = {name: study}
        rows = pick(results, study=name)
        for kind, text in (
            ("brief", f"```\n{brief(rows, one_study, WIDEST).strip()}\n```"),
            ("tables", document(rows, one_study)),
            (arithmetic, scorecards(rows, one_study)),
        ):
            texts[Block(name, study.budget, kind)] = text
    return texts


def document(results: pd.DataFrame, studies: Mapping[str, Study]) -> str:
    """All tables, recorded studies first.

    There is an entry for each study and cell size (`grid`); a study of viewpoints alone has no
    scores, and is left out.
    """
    entries = []
    for study in sorted(studies.values(), key=lambda study: study.simulated):
        for grid in study.grids:
            if scores := _scores(results, study, grid.name):
                entries.append({"study": study, "grid": grid, "tables": list(_tables(scores))})
    return template("results.md.j2", studies=entries)


def scorecards(results: pd.DataFrame, studies: Mapping[str, Study]) -> str:
    """The scorecard of each study and cell size, without the time of a query."""
    untimed = results[results["number"] != "query_ms"]
    texts = []
    for study in studies.values():
        for grid in study.grids:
            if scores := _scores(untimed, study, grid.name):
                texts.append(tables.scorecard(scores).markdown())
    return "\n".join(texts)


def _scores(results: pd.DataFrame, study: Study, grid: str) -> list[Scores]:
    """The scores of the study at one cell size, the best model's first; empty if it has none."""
    scores = read_scores(pick(results, study=study.name, grid=grid), study.tests)
    if not scores:
        return []
    return [score for group in ranked(scores).values() for score in group]


def _tables(scores: Sequence[Scores]) -> Iterator[Table]:
    """The tables of one study at one cell size."""
    yield tables.scorecard(scores)
    for protocol, name in OVER_DAYS:
        yield tables.over_days(f"by_{protocol}_{name}", scores, protocol, name)
    if posed := [score for score in scores if score.posed]:
        headings = ("method", "day")
        yield tables.pose_table("posed", headings, posed, POSES_IN_DOCUMENT)
        yield tables.pose_table("pose_answers", headings, posed, ANSWERS)
