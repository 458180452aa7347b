"""The parts of a study in the page: its set-up, its results by both protocols, and its figures, each with its sources."""

from collections.abc import Iterator, Sequence

from pipeline.errors import ArtifactError
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.leaflet import wording
from pipeline.leaflet.answer import ranked
from pipeline.leaflet.chapter import Chapter
from pipeline.leaflet.costs import costs
from pipeline.leaflet.markup import Html, inline, join, prose, tag
from pipeline.leaflet.plate import plate
from pipeline.leaflet.sortable import sortable
from pipeline.leaflet.sources import disclosure, place
from pipeline.reports import comparison, setup, tables
from pipeline.reports.gallery import plates
from pipeline.reports.study import Study
from pipeline.reports.wording import HOW_TO_READ, MARKED

TELLING = ("year", "precision_recall", "recall_at", "montage", "novelty", "rejection", "reliability", "matches")
"""Kinds of figure that the page shows, in its order: of those of one method, the one's that finds most."""


def described(chapter: Chapter) -> Html:
    """What was driven and what each method was given to learn with."""
    study, words = chapter.study, chapter.words
    told = wording.DRIVEN.format(
        driven=f"made in the world `{words['world']}`" if study.simulated else f"read from `{words['root']}`",
        train=study.train,
        tests=len(chapter.sequences),
        submap=words["submap"],
        budget=words["budget"],
        rows=len(study.train_xy_m),
        places=len(set(study.train_places.tolist())),
    )

    def learned(row: Sequence[str], heading: str, column: int) -> str:
        return place(chapter.path("train", method=row[0]))

    sources = [chapter.path("train", method=method) for method in study.models]
    sources += [chapter.path("labels", sequence) for sequence in (study.train, *chapter.sequences)]
    return join(
        [
            chapter.head(),
            tag("p", inline(told)),
            sortable(setup.table(study.models, longest=400), wording.METHODS, learned),
            sortable(tables.sequences(study.results), wording.SEQUENCES, chapter.where),
            sortable(costs(chapter.files, chapter.timed), wording.COSTS, lambda row, *_: place(chapter.models[row[0]])),
            disclosure(f"{chapter.name}-setup", sources, chapter.made_with),
        ]
    )


def compared(chapter: Chapter) -> Html:
    """Tables by both protocols, against the first method, and the means of all else."""
    study, marks = chapter.study, comparison.marks(chapter.study.tested)
    blocks, told = [chapter.head()], {"cell_m": study.cell_m, **vars(study.distance)}
    reference = study.tested[0].reference if study.tested else ""
    if reference:
        blocks.append(prose(MARKED.format(reference=reference)))
    for protocol in reversed(PROTOCOLS):
        blocks += [tag("h4", f"By {protocol}"), prose(wording.BY[protocol].format(**told))]
        for number, caption in wording.MAIN.items():
            table = tables.main(study.results, protocol, number, marks)
            blocks.append(sortable(table, caption.format(protocol=protocol), chapter.where))
    further = [(tables.means(study.results), wording.MEANS)]
    if headings := tables.headings(study.results):
        further.append((headings, wording.HEADINGS))
    for protocol in PROTOCOLS if reference else ():
        caption = wording.COMPARED.format(reference=reference, protocol=protocol)
        further.append((comparison.table(study.tested, protocol), caption))
    folded = [tag("summary", "Further tables"), *(sortable(table, caption, chapter.where) for table, caption in further)]
    sources = [chapter.path("metrics", method=method) for method in study.models]
    sources += [chapter.path("evaluate", sequence, method) for method in study.models for sequence in chapter.sequences]
    return join([*blocks, tag("details", *folded), disclosure(f"{chapter.name}-results", sources, chapter.made_with)])


def drawn(chapter: Chapter, missing: list[str]) -> Html:
    """The most telling figures of the report; what is not drawn is added to `missing`."""
    shown, folder = [chapter.head()], chapter.artifacts.parent / chapter.drawn
    for kind, title, file in _telling(chapter.study):
        try:
            shown.append(plate(folder / file, title, HOW_TO_READ[kind]))
        except ArtifactError as error:
            missing.append(str(error))
    sources = [chapter.drawn] + [chapter.path("metrics", method=method) for method in chapter.study.models]
    return join([*shown, disclosure(f"{chapter.name}-figures", sources, chapter.made_with)])


def _telling(study: Study) -> Iterator[tuple[str, str, str]]:
    """Kind, title and file of each figure to show."""
    best = ranked(study)[0]
    there = [plate for plate in plates(study) if plate.method in ("", best) and not plate.sequence]
    for kind in TELLING:
        yield from ((kind, one.illustration.title, one.illustration.path) for one in there if one.illustration.kind == kind)
