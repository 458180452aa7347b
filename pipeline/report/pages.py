"""Fills the result blocks of README.md and docs/RESULTS.md from the tables of results.

A block is the text between `<!-- results: STUDY BUDGET KIND -->` and `<!-- end of results -->`.
`blocks` lists those of a page, `table_texts` makes texts for them, and `filled` puts them in.
"""

import re
from collections.abc import Mapping
from typing import NamedTuple

import pandas as pd

from pipeline.core.errors import ConfigError
from pipeline.report.brief import WIDEST, brief
from pipeline.report.document import document, scorecards
from pipeline.studies.study import Study

PAGES = "README.md", "docs/index.md", "docs/RESULTS.md"
MARK = re.compile(
    r"(<!-- results: (?P<words>[^>]*?) -->\n)(?P<text>.*?)(<!-- end of results -->)", re.DOTALL
)
PICTURE = "picture"
KINDS = "brief", "tables", "bfloat16", "float32", PICTURE


class Block(NamedTuple):
    """What a mark such as `<!-- results: campus minutes brief -->` asks for."""

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
        rows = results[results["study"] == name]
        for kind, text in (
            ("brief", f"```\n{brief(rows, one_study, WIDEST).strip()}\n```"),
            ("tables", document(rows, one_study)),
            (arithmetic, scorecards(rows, one_study)),
        ):
            texts[Block(name, study.budget, kind)] = text
    return texts
