"""`yearloc results`: the results of the studies in use, for a terminal, a page or a program."""

import sys
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import some_words
from pipeline.cli.project import read_studies
from pipeline.core.errors import ArtifactError, ConfigError
from pipeline.running.texts import folded, terminal_width

if TYPE_CHECKING:
    import pandas as pd

    from pipeline.studies.study import Study


MOVING = Path("docs/year.gif")
"""README's picture."""
PAPERS = "papers"
"""The kind of --write that is a page of its own: what the papers found."""


def results(
    words: Annotated[
        list[str],
        some_words("COLUMN=VALUE|KIND", "further ones of --where, and the kinds of --write"),
    ],
    where: Annotated[
        list[str],
        typer.Option(
            metavar="COLUMN=VALUE",
            default_factory=list,
            show_default=False,
            help="only these rows; commas between values",
        ),
    ],
    full: Annotated[
        bool, typer.Option("--full", help="all tables of the report, with intervals")
    ] = False,
    csv: Annotated[
        bool, typer.Option("--csv", help="every number: a header line and a row a number")
    ] = False,
    json: Annotated[bool, typer.Option("--json", help="the same as a list of objects")] = False,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="all tables, as in docs/RESULTS.md")
    ] = False,
    write: Annotated[
        bool,
        typer.Option(
            "--write",
            help="fill the marked blocks of README.md and docs/, of all kinds or these: brief, "
            "tables, bfloat16, float32, picture, and docs/papers.md: papers",
        ),
    ] = False,
    keep: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            show_default=False,
            help="keep in docs/papers/ what the papers' findings read: nway, street, compare, real",
        ),
    ] = "",
) -> None:
    """The results in a few lines, all tables, or every number as csv or json."""
    if words and not (write or where):
        raise typer.BadParameter(
            "a word of --where or --write, and neither is there", param_hint=words[0]
        )
    if write and words == [PAPERS]:
        return _write_papers()
    studies = read_studies()
    if full:
        return _full([(name, grid) for name, study in studies.items() for grid in study.grid_names])
    from pipeline.evaluation.results import read
    from pipeline.evaluation.results import where as selected
    from pipeline.evaluation.rows import COLUMNS
    from pipeline.studies.layout import Layout
    from pipeline.studies.measured import stale

    table = read(Layout(), studies)
    for name in stale(Layout(), studies):
        print(
            f"{name}: conf/studies.yaml changed after this was measured; `dvc repro` measures it "
            "anew",
            file=sys.stderr,
        )
    if markdown:
        from pipeline.report.document import document

        return print(document(table, studies), end="")
    if keep:
        return _keep(keep, table, studies)
    if write:
        return _write(table, studies, words)
    if not (csv or json or where):
        from pipeline.report.brief import brief

        print(brief(table, studies, get_terminal_size().columns))
        return print("all tables: yearloc results --full; a page: artifacts/report/page.html")
    conditions = [*where, *words]
    table = selected(table, dict(word.partition("=")[::2] for word in conditions))[[*COLUMNS]]
    if table.empty:
        raise ConfigError(
            f"--where {' '.join(conditions)}: no such row; `yearloc results --csv` has them all"
        )
    if csv:
        return print(table.to_csv(index=False), end="")
    if json:
        return print(table.to_json(orient="records"))
    return print(
        table.to_string(
            index=False, na_rep="–", float_format="{:.4g}".format, line_width=terminal_width()
        )
    )


def _write(table: "pd.DataFrame", studies: "dict[str, Study]", kinds: list[str]) -> None:
    """Fill the blocks of the pages that these studies can fill.

    Only blocks of these `kinds`; of all kinds if none are given.
    """
    from pipeline.cli.picture import draw
    from pipeline.core.replacing import replace
    from pipeline.networks.loop import arithmetic
    from pipeline.report.pages import KINDS, PAGES, PICTURE, blocks, filled, table_texts

    all_kinds = (*KINDS, PAPERS)
    if unknown := [kind for kind in kinds if kind not in all_kinds]:
        raise ConfigError(f"--write {unknown[0]}: expected some of {', '.join(all_kinds)}")
    kinds = kinds or list(all_kinds)
    texts = {
        block: text
        for block, text in table_texts(table, studies, arithmetic()).items()
        if block.kind in kinds
    }
    pages = {path: path.read_text(encoding="utf-8") for path in map(Path, PAGES)}
    blocks_by_page = {path: blocks(page) for path, page in pages.items()}
    pictures = sorted(
        {
            block
            for page_blocks in blocks_by_page.values()
            for block in page_blocks
            if block.kind == PICTURE
        }
    )
    if len(pictures) > 1:
        raise ConfigError(
            f"{' and '.join(PAGES)}: {len(pictures)} different pictures are wanted, and {MOVING} "
            "holds one"
        )
    for block in pictures if PICTURE in kinds else ():
        study = studies.get(block.study)
        if (
            study
            and study.budget == block.budget
            and block.model in [answers.name for answers in study.answerers]
        ):
            texts[block] = draw(
                f"{block.study}/{study.grids[0].name}/{block.model}", None, MOVING
            ).page
    for path, page in pages.items():
        with replace(path) as scratch:
            scratch.write_text(filled(page, texts), encoding="utf-8")
        for block in blocks_by_page[path]:
            print(
                f"{path}: {' '.join(filter(None, block))}: "
                f"{'written' if block in texts else 'left as it is'}"
            )
    if PAPERS in kinds and any(Path("docs/papers").glob("*.csv")):
        _write_papers()


def _write_papers() -> None:
    """Write docs/papers.md from the tables that are kept."""
    from pipeline.papers import page

    page.write()
    print(f"{page.PAGE}: written")


def _keep(name: str, table: "pd.DataFrame", studies: "dict[str, Study]") -> None:
    """Keep the rows that the papers' findings read, and say on what machine and when."""
    from datetime import date
    from importlib.metadata import version

    import torch

    from pipeline.evaluation.timing import processor
    from pipeline.networks.loop import arithmetic
    from pipeline.papers.kept import keep

    gpu = torch.cuda.get_device_name() if torch.cuda.is_available() else ""
    machine = f"{gpu or processor()}, torch {version('torch')}, {arithmetic()}"
    path = keep(name, table, studies, date.today().isoformat(), machine)
    print(f"{path}: written; `yearloc results --write {PAPERS}` fills docs/papers.md")


def _full(places: list[tuple[str, str]]) -> None:
    from pipeline.studies.layout import Layout

    for text in (Layout().path("report", *place, "results.txt") for place in places):
        if not text.is_file():
            raise ArtifactError(f"{text.parent}: no report yet; `dvc repro` writes it")
        print(folded(text.read_text(encoding="utf-8"), terminal_width()))
    print("a page to read: artifacts/report/page.html; dashboard: make dashboard")
