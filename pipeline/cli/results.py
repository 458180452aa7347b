"""`yearloc results` prints the table of results, or writes it into the project's pages.

Every measured number is a row of this table. The command prints it in a few lines, in full, as csv,
as json or as markdown, and fills the blocks of README.md and docs/ that show numbers.
"""

import sys
from importlib import import_module
from itertools import chain
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.options import some_words
from pipeline.cli.project import read_studies
from pipeline.core.errors import ArtifactError, ConfigError, NotInstalledError
from pipeline.running.texts import folded, terminal_width

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from collections.abc import Iterable

    import pandas as pd

    from pipeline.report.pages import Block
    from pipeline.studies.study import Study


README_PICTURE = Path("docs/year.gif")
"""The moving picture that README.md shows."""
PAPERS = "papers"
"""The kind of --write that fills docs/papers.md, what the papers found beside these numbers."""

Words = Annotated[
    list[str],
    some_words(
        "COLUMN=VALUE|KIND", "Further conditions of --where, or the kinds of blocks for --write"
    ),
]
Where = Annotated[
    list[str],
    typer.Option(
        metavar="COLUMN=VALUE",
        default_factory=list,
        show_default=False,
        help="Print only rows with this value in this column; commas separate several values",
    ),
]
Full = Annotated[
    bool, typer.Option("--full", help="Print all tables of the report, with intervals")
]
Csv = Annotated[bool, typer.Option("--csv", help="Print every number as CSV, one per row")]
Json = Annotated[bool, typer.Option("--json", help="Print every number as a JSON list of objects")]
Markdown = Annotated[
    bool, typer.Option("--markdown", help="Print all tables as Markdown, as in docs/RESULTS.md")
]
Write = Annotated[
    bool,
    typer.Option(
        "--write",
        help="Fill the marked blocks of README.md and docs/ with the numbers: all kinds of blocks, "
        "or some of brief, tables, bfloat16, float32, picture, papers (docs/papers.md)",
    ),
]
Keep = Annotated[
    str,
    typer.Option(
        "--keep",
        metavar="NAME",
        show_default=False,
        help="Keep in docs/papers/ the rows that are compared with the papers' findings, under "
        "the name nway, street, compare or real",
    ),
]


def results(
    words: Words,
    where: Where,
    full: Full = False,
    csv: Csv = False,
    json: Json = False,
    markdown: Markdown = False,
    write: Write = False,
    keep_name: Keep = "",
) -> None:
    """Print the results: in a few lines, as all tables, or every number as CSV or JSON."""
    if words and not (write or where):
        raise typer.BadParameter(
            "a word of --where or --write, and neither is there", param_hint=words[0]
        )
    if write and words == [PAPERS]:
        _write_papers()
        return
    studies = read_studies()
    # Of several options only the first of this order counts: --full, --markdown, --keep, --write,
    # then --csv, --json and --where, which go together (--csv before --json).
    if full:
        _print_reports(studies)
        return
    table = _table(studies)
    if markdown:
        from pipeline.report.pages import document

        print(document(table, studies), end="")
    elif keep_name:
        _keep(keep_name, table, studies)
    elif write:
        _write_pages(table, studies, words)
    elif csv or json or where:
        _print_rows(table, [*where, *words], csv, json)
    else:
        from pipeline.report.brief import brief

        print(brief(table, studies, get_terminal_size().columns))
        print("all tables: yearloc results --full; a page: artifacts/report/page.html")


def _table(studies: "dict[str, Study]") -> "pd.DataFrame":
    """Read the table of results, and warn of studies that changed since they were measured."""
    from pipeline.evaluation.results import read
    from pipeline.studies.layout import Layout
    from pipeline.studies.measured import stale

    table = read(Layout(), studies)
    for name in stale(Layout(), studies):
        print(
            f"{name}: conf/studies.yaml changed after this was measured; `dvc repro` measures it "
            "again",
            file=sys.stderr,
        )
    return table


def _print_reports(studies: "dict[str, Study]") -> None:
    """Print the text report of each study and cell size, which stage `report` wrote."""
    from pipeline.studies.layout import Layout

    for name, study in studies.items():
        for grid in study.grid_names:
            path = Layout().path("report", name, grid, "results.txt")
            if not path.is_file():
                raise ArtifactError(f"{path.parent}: no report yet; `dvc repro` writes it")
            print(folded(path.read_text(encoding="utf-8"), terminal_width()))
    print("a page to read: artifacts/report/page.html; dashboard: make dashboard")


def _print_rows(table: "pd.DataFrame", conditions: list[str], csv: bool, json: bool) -> None:
    """Print the rows that meet all conditions COLUMN=VALUE, as csv, as json or in columns.

    Raises ConfigError if there is no such row.
    """
    from pipeline.evaluation.results import where as rows_where
    from pipeline.evaluation.rows import COLUMNS

    value_of_column = {}
    for condition in conditions:
        column, _, value = condition.partition("=")
        value_of_column[column] = value
    rows = rows_where(table, value_of_column)[[*COLUMNS]]
    if rows.empty:
        raise ConfigError(
            f"--where {' '.join(conditions)}: no such row; `yearloc results --csv` has them all"
        )
    if csv:
        print(rows.to_csv(index=False), end="")
    elif json:
        print(rows.to_json(orient="records"))
    else:
        width = terminal_width()
        print(
            rows.to_string(index=False, na_rep="–", float_format="{:.4g}".format, line_width=width)
        )


def _write_pages(table: "pd.DataFrame", studies: "dict[str, Study]", kinds: list[str]) -> None:
    """Fill the marked blocks of README.md and docs/ with numbers of these studies.

    Only blocks of the given kinds are filled, or all blocks without a kind. A block for which the
    studies have no numbers is left as it is. Raises ConfigError for an unknown kind.
    """
    from pipeline.core.replacing import write_text
    from pipeline.networks.loop import arithmetic
    from pipeline.report.pages import KINDS, PAGES, PICTURE, blocks, filled, table_texts

    all_kinds = (*KINDS, PAPERS)
    if unknown := [kind for kind in kinds if kind not in all_kinds]:
        raise ConfigError(f"--write {unknown[0]}: expected some of {', '.join(all_kinds)}")
    kinds = kinds or list(all_kinds)
    pages = {path: path.read_text(encoding="utf-8") for path in map(Path, PAGES)}
    blocks_by_page = {path: blocks(page) for path, page in pages.items()}
    texts = {
        block: text
        for block, text in table_texts(table, studies, arithmetic()).items()
        if block.kind in kinds
    }
    all_blocks = chain.from_iterable(blocks_by_page.values())
    picture_blocks = {block for block in all_blocks if block.kind == PICTURE}
    if len(picture_blocks) > 1:
        raise ConfigError(
            f"{' and '.join(PAGES)}: {len(picture_blocks)} different pictures are wanted, and "
            f"{README_PICTURE} holds one"
        )
    if PICTURE in kinds:
        texts |= _picture_texts(picture_blocks, studies)
    for path, page in pages.items():
        write_text(path, filled(page, texts))
        for block in blocks_by_page[path]:
            block_words = " ".join(filter(None, block))  # a field that its mark lacks is empty
            outcome = "written" if block in texts else "left as it is"
            print(f"{path}: {block_words}: {outcome}")
    if PAPERS in kinds and any(Path("docs/papers").glob("*.csv")):
        _write_papers()


def _picture_texts(blocks: "Iterable[Block]", studies: "dict[str, Study]") -> "dict[Block, str]":
    """Draw the picture of each block that these studies have answers for; returns the texts."""
    from pipeline.cli.picture import draw

    texts = {}
    for block in blocks:
        study = studies.get(block.study)
        if study is None or study.budget != block.budget:
            continue
        if block.model in [answers.name for answers in study.answerers]:
            name = f"{block.study}/{study.grids[0].name}/{block.model}"
            _, texts[block] = draw(name, None, README_PICTURE)
    return texts


def _papers(module: str) -> Any:
    """Import a module of benchmarks/papers, which fills docs/papers.md.

    Raises NotInstalledError if only the library is installed.
    """
    try:
        return import_module(f"benchmarks.papers.{module}")
    except ModuleNotFoundError:
        raise NotInstalledError(
            "docs/papers.md: filled by benchmarks/papers, which only a clone of yearloc has"
        ) from None


def _write_papers() -> None:
    """Write docs/papers.md from the tables in docs/papers/."""
    print(f"{_papers('page').write()}: written")


def _keep(name: str, table: "pd.DataFrame", studies: "dict[str, Study]") -> None:
    """Keep the rows that are compared with the papers' findings, with the machine and the date."""
    from datetime import date
    from importlib.metadata import version

    import torch

    from pipeline.evaluation.timing import processor
    from pipeline.networks.loop import arithmetic

    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else ""
    machine = f"{gpu or processor()}, torch {version('torch')}, {arithmetic()}"
    path = _papers("kept").keep(name, table, studies, date.today().isoformat(), machine)
    print(f"{path}: written; `yearloc results --write {PAPERS}` fills docs/papers.md")
