"""Surveyed days that a model of the first one learns in their order (METHODS 11.1)."""

from collections.abc import Iterable, Iterator, Sequence

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.matching.places import Places
from pipeline.matching.ranking import Method, Model, Rows, TrainingSet


def in_order(days: Iterable[Rows], places: Places) -> Iterator[tuple[TrainingSet, Places]]:
    """Yield the views of each day with their places, and all places by then.

    Places keep their numbers; each further cell gets a new one.
    """
    for views in days:
        places = places.grown(xy_m := views.world_T_anchor[:, :2, 3])
        yield TrainingSet(views, places.at(xy_m)), places


def grown(
    method: Method, model: Model, days: Sequence[Rows], places: Places, progress: Progress
) -> tuple[Model, TrainingSet]:
    """The model after the further days, and all that it learned.

    `model` is of the first of `days`, whose `places` are those of its labels. Raises InputError for
    a single day.
    """
    known_set, *later_sets = (data for data, _ in in_order(days, places))
    if not later_sets:
        raise InputError(
            "from: the model knows the only sequence already; name the further ones after it"
        )
    for number, new_set in enumerate(later_sets, 1):
        model = method.grow(model, known_set, new_set, progress.part(f"day{number}"))
        known_set = TrainingSet.joined([known_set, new_set])
    return model, known_set
