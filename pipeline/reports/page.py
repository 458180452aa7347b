"""report.md: the set-up, the protocols, the tables, the figures with how to read each, and what the words mean."""

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING

from pipeline.evaluation.paired import LEVEL
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.reports import comparison, findings, setup, tables, wording
from pipeline.reports.illustration import Illustration
from pipeline.reports.table import WIDEST

if TYPE_CHECKING:
    from pipeline.reports.study import Study


def report(study: "Study", illustrations: Sequence[Illustration]) -> str:
    """The whole of report.md."""
    others = len(tables.sequences(study.results).rows)
    bullets = [f"trained on the one sequence {study.train}, tested on {others} others", f"grid cells of {study.cell_m:g} m"]
    blocks = [
        f"# Localising in {study.dataset}\n",
        *([wording.SIMULATED] if study.simulated else []),
        "## Set-up\n",
        _list(bullets),
        setup.table(study.models, longest=400).markdown(),
        _list(setup.settings(study.models)),
        "## Two protocols\n",
        wording.JUDGED_BY.format(cell_m=study.cell_m, **vars(study.distance)),
        "## Test sequences\n",
        tables.sequences(study.results).markdown(),
        *(block for protocol in PROTOCOLS for block in _results(study, protocol)),
        *_compared(study),
        *_headings(study),
        "## Kinds of novelty\n",
        wording.KINDS,
        *(block for protocol in PROTOCOLS for block in _kinds(study, protocol)),
        *(["## Figures\n", *_figures(illustrations)] if illustrations else []),
        "## Every sequence\n",
        *(text for p in PROTOCOLS for text in (f"### Each by {p}\n", tables.everything(study.results, p).markdown())),
        "## What the words mean\n",
        wording.DEFINITIONS.format(**vars(study.bootstrap)),
    ]
    return "\n".join(blocks)


def text(study: "Study") -> str:
    """results.txt: the methods and their results by both protocols for a terminal."""
    made = f"simulated {study.dataset}" if study.simulated else study.dataset
    head = f"{made}, trained on {study.train} alone, cells of {study.cell_m:g} m"
    cells = (
        f"By cells of {study.cell_m:g} m: seen = training was in the query's cell, right = that cell;"
        " a misplaced query does not lower recall."
    )
    metres = (
        f"By distance: seen = a training pose within {study.distance.seen_m:g} m,"
        f" right = within {study.distance.correct_m:g} m; a misplaced query lowers recall."
    )
    marks = comparison.marks(study.tested)
    words = wording.WORDS + (wording.TOLD_HEADINGS if tables.headings(study.results) else "")
    words += wording.SURELY.format(**_reference(study)) if study.tested else ""
    blocks = [f"{head}\n", setup.table(study.models).text()]
    for protocol, told in zip(PROTOCOLS, (cells, metres), strict=True):
        blocks += [told, *(tables.main(study.results, protocol, key, marks).text() for key in tables.MAIN)]
    return "\n".join((*blocks, tables.means(study.results).text(), fill(words, WIDEST - 20) + "\n"))


def _results(study: "Study", protocol: str) -> list[str]:
    marks = comparison.marks(study.tested)
    blocks = [f"## Results by {protocol}\n", *([wording.MARKED.format(**_reference(study))] if marks else [])]
    return blocks + [tables.main(study.results, protocol, key, marks).markdown() for key in tables.MAIN]


def _compared(study: "Study") -> list[str]:
    if not study.tested:
        return []
    blocks = [f"## Against `{study.tested[0].reference}`\n", wording.PAIRED.format(**_reference(study))]
    for protocol in PROTOCOLS:
        told = findings.comparisons(study.tested, protocol)
        blocks += [f"### Differences by {protocol}\n", comparison.table(study.tested, protocol).markdown(), _list(told)]
    return blocks


def _reference(study: "Study") -> dict[str, object]:
    """What the texts on the paired test name."""
    resamples = study.bootstrap.resamples
    return {
        "reference": study.tested[0].reference,
        "resamples": resamples,
        "one_more": resamples + 1,
        "level": LEVEL,
    }


def _headings(study: "Study") -> list[str]:
    table = tables.headings(study.results)
    return ["## Headings\n", wording.HEADINGS, table.markdown()] if table else []


def _kinds(study: "Study", protocol: str) -> list[str]:
    told = findings.novelties(study.results, protocol)
    return [f"### By {protocol}\n", tables.novelties(study.results, protocol).markdown(), *([_list(told)] if told else [])]


def _figures(illustrations: Sequence[Illustration]) -> list[str]:
    """Those of one kind after each other, with how to read them said once; maps of single sequences are linked."""
    kinds: dict[str, list[Illustration]] = {}
    for one in illustrations:
        kinds.setdefault(one.kind, []).append(one)
    blocks = []
    for kind, group in kinds.items():
        shown = [f"### {one.title}\n\n![{one.title}]({one.path})\n" for one in group]
        if kind == "map":
            shown = ["### Maps of single sequences\n", _list([f"[{one.title}]({one.path})" for one in group])]
        blocks += [shown[0], f"{wording.HOW_TO_READ[kind]}\n", *shown[1:]]
    return blocks


def _list(lines: Sequence[str]) -> str:
    return "".join(f"- {line}\n" for line in lines)
