"""Incremental learning (METHODS 11.1): a first day's model and the views of further days go in, the
model of all days comes out.
"""

from collections.abc import Iterable, Iterator, Sequence

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.matching.places import Places
from pipeline.matching.ranking import Method, Model, Rows, TrainingSet


def in_order(days: Iterable[Rows], places: Places) -> Iterator[tuple[TrainingSet, Places]]:
    """Yield, day by day, the views with their places, and all places known so far.

    Places keep their numbers; each cell that a day visits for the first time gets a new number.
    """
    for views in days:
        xy_m = views.world_T_anchor[:, :2, 3]
        places = places.extended(xy_m)
        yield TrainingSet(views, places.at(xy_m)), places


def extended(
    method: Method, model: Model, days: Sequence[Rows], places: Places, progress: Progress
) -> tuple[Model, TrainingSet]:
    """Extend a model by further days; returns the new model, and all views that it learned.

    `model` learned the first of `days`, with `places` as its labels. Raises InputError if there is
    no further day.
    """
    learned_set, *further_sets = (views for views, _ in in_order(days, places))
    if not further_sets:
        raise InputError(
            "from: the model knows the only sequence already; name the further ones after it"
        )
    for number, day_set in enumerate(further_sets, 1):
        model = method.extend(model, learned_set, day_set, progress.part(f"day{number}"))
        learned_set = TrainingSet.joined([learned_set, day_set])
    return model, learned_set
