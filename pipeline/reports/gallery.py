"""Which figures a study has, under what file names, and how each is drawn."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from matplotlib.figure import Figure

from pipeline import schemas, store
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.reports import examples, maps, matches, novelty, plots, rejection, reliability, year
from pipeline.reports.illustration import Illustration
from pipeline.reports.result import Result, by_method
from pipeline.reports.style import save

if TYPE_CHECKING:
    from pipeline.reports.study import Study


@dataclass(frozen=True)
class Plate:
    """One figure file of a study."""

    illustration: Illustration
    draw: Callable[[], Figure | None]
    method: str = ""
    """Whose it is; empty for a figure of all methods."""
    sequence: str = ""
    """The one test sequence that it shows; empty for a figure of all."""
    optional: bool = False
    """`draw` gives None where there is nothing to draw it from."""


def plates(study: "Study") -> Iterator[Plate]:
    """Every figure of a study, in the report's order."""

    def plate(kind: str, name: str, title: str, draw: Callable[[], Figure | None], *whose: Any) -> Plate:
        return Plate(Illustration(kind, f"{name}.svg", title), draw, *whose)

    results, simulated = study.results, study.simulated
    for protocol in PROTOCOLS:
        draw = partial(plots.precision_recall, results, protocol, simulated)
        yield plate("precision_recall", f"precision_recall_{protocol}", f"Precision and recall by {protocol} (Fig. 6)", draw)
    yield plate("year", "year", "Over the year (Fig. 8)", partial(year.year, results, study.train, simulated))
    yield plate("recall_at", "recall_at", "Recall among the first n places", partial(plots.recall_at, results, simulated))
    title = "Where queries were placed right and wrong"
    yield plate("montage", "outcomes", title, partial(maps.montage, results, study.train_xy_m, simulated))
    for method, group in by_method(results).items():
        yield from _of_method(study, plate, method, group)


def draw(study: "Study", folder: Path) -> list[Illustration]:
    """Draw every figure of a study into a folder."""
    drawn = []
    for plate in plates(study):
        if figure := plate.draw():
            save(figure, folder / plate.illustration.path)
            drawn.append(plate.illustration)
    return drawn


def files(study: "Study", folder: Path, method: str, sequence: str = "") -> list[Path]:
    """The files that belong to a method, those of all methods included; or to it on one test sequence."""
    return [
        folder / plate.illustration.path
        for plate in plates(study)
        if plate.sequence == sequence
        and (plate.method == method or not (plate.method or sequence))
        and not (plate.optional and not (folder / plate.illustration.path).is_file())
    ]


def _of_method(study: "Study", plate: Callable[..., Plate], method: str, group: list[Result]) -> Iterator[Plate]:
    simulated, model = study.simulated, study.models[method]
    title = f"{method}: {group[0].evaluation.kinds[0].replace('_', ' ')} of seen and unseen (Fig. 4)"
    yield plate("novelty", f"novelty_{method}", title, partial(novelty.histograms, group, "cells", simulated), method)
    title = f"{method}: what rejecting gave"
    yield plate("rejection", f"rejection_{method}", title, partial(rejection.rejection, group, simulated), method)
    if reliability.pooled(group):
        title = f"{method}: does its confidence mean what it says?"
        yield plate("reliability", f"reliability_{method}", title, partial(reliability.diagram, group, simulated), method)
    if chosen := examples.choose(group):
        title = f"{method}: queries and what they were matched with (Fig. 7)"
        yield plate("matches", f"matches_{method}", title, partial(_matches, study, method, chosen), method, "", True)
    for result in group:
        name, draw = f"outcomes_{method}_{result.sequence}", partial(maps.outcome_map, result, study.train_xy_m, simulated)
        yield plate("map", name, f"{method} on {result.label}", draw, method, result.sequence)
    if model.curves:
        draw = partial(plots.history, model.curves, model.best_round, method, simulated)
        yield plate("history", f"history_{method}", f"How {method} was learned", draw, method)


def _matches(study: "Study", method: str, chosen: list[examples.Example]) -> Figure | None:
    """Drawn of the method's own Scan Contexts, else of another method's; None where no method of the study looks at any.

    Opens the views, of which only the few rows that are shown are read.
    """

    def views(sequence: str, method: str) -> store.Artifact:
        return store.read(study.find("views", sequence, method), *schemas.LOOKED_AT)

    lookers = [method, *(other for other in study.models if other != method)]
    drawable = [one for one in lookers if views(study.train, one).attrs["kind"] == schemas.VIEWS.kind]
    if not drawable:
        return None

    def images(sequence: str) -> Any:
        return views(sequence, drawable[0])["images"]

    training = matches.Training(images(study.train), study.train_places, study.train_xy_m)
    return matches.matches(chosen, training, images, study.simulated, own=drawable[0] == method)
