"""Surveyed days that a model of the first one learns in their order (METHODS 11.1)."""

from collections.abc import Iterable, Iterator, Sequence

from pipeline.errors import InputError
from pipeline.matching.places import Places
from pipeline.matching.ranking import Method, Model, Rows, TrainingSet
from pipeline.running.progress import Progress


def in_order(days: Iterable[Rows], places: Places) -> Iterator[tuple[TrainingSet, Places]]:
    """Each day with its places: those of `places`, then a number more for each further cell; and
    all places by then."""
    for views in days:
        places = places.grown(xy_m := views.world_T_anchor[:, :2, 3])
        yield TrainingSet(views, places.at(xy_m)), places


def grown(
    method: Method, model: Model, days: Sequence[Rows], places: Places, progress: Progress
) -> tuple[Model, TrainingSet]:
    """The model of the first of `days`, whose `places` are those of its labels, once it learned the
    others; and all that it learned. Raises InputError for a single day."""
    known, *later = (data for data, _ in in_order(days, places))
    if not later:
        raise InputError(
            "from: the model knows the only sequence already; name the further ones after it"
        )
    for number, new in enumerate(later, 1):
        model = method.grow(model, known, new, progress.part(f"day{number}"))
        known = TrainingSet.joined([known, new])
    return model, known
