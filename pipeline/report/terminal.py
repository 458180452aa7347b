"""The results of a study as plain text for a terminal, and where its report lies.

In: a study. Out: the text of results.txt: its main tables with captions, and doubts about them.
"""

import textwrap
from collections.abc import Iterator
from itertools import product

from pipeline.report import findings, tables
from pipeline.report.render import caption, sentence, words
from pipeline.report.result import grouped
from pipeline.report.strategies import read_strategies
from pipeline.report.study import Study
from pipeline.report.table import WIDEST


def text(study: Study, figures: int) -> str:
    """The text of a study; `figures` is the number of figures in its report."""
    report = study.layout.path("report", study.name, study.grid, "report.md")
    return "\n".join([*_blocks(study), f"  {report}, with {figures} figures beside it\n"])


def _blocks(study: Study) -> Iterator[str]:
    """The lines and tables of a study, by the questions that it asks."""
    if study.settings.asks_about_the_year:
        yield f"{study.where}, trained on {study.train} alone, cells of {study.cell_m:g} m\n"
        yield tables.setup(study, longest=78).text()
        for protocol, number in product(tables.DISTANCE_FIRST, tables.MAIN_NUMBERS):
            main_table = tables.main_number(study, protocol, number)
            yield from (_wrap(caption(main_table)), main_table.text())
        yield from (tables.means(study).text(), _wrap(words("terminal")) + "\n")
        if posed := [result for result in study.results if result.posed]:
            for pose_table in tables.pose_tables(posed):
                yield from (_wrap(caption(pose_table)), pose_table.text())
        if doubts := [_wrap(sentence(doubt)) for doubt in findings.doubts(study)]:
            yield "\n".join(doubts) + "\n"
    if study.settings.learns_further_days:
        yield f"{study.where}: after the last step of learning, means over the seeds\n"
        for order, strategies in grouped(read_strategies(study.rows), "order").items():
            for order_table in tables.of_order(order, strategies):
                yield _wrap(caption(order_table)) + "\n" + order_table.text()
    elif study.settings.bird_view_methods:
        yield (
            f"{study.where}: each sequence matched with itself, from headings between the "
            "reference's\n"
        )
        yield from (viewpoint_table.text() for viewpoint_table in tables.over_headings(study))


def _wrap(line: str) -> str:
    """A sentence without its marks of markdown, in lines that a terminal has room for."""
    return textwrap.fill(line.replace("`", "").replace("*", ""), WIDEST - 20)
