"""Growth of a model (METHODS 11.1): a model of the first day and further surveyed days in; a model
of all out."""

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
        xy_m = views.world_T_anchor[:, :2, 3]
        places = places.grown(xy_m)
        yield TrainingSet(views, places.at(xy_m)), places


def grown(
    method: Method, model: Model, days: Sequence[Rows], places: Places, progress: Progress
) -> tuple[Model, TrainingSet]:
    """The model after the further days, and all that it learned.

    `model` is of the first of `days`, whose `places` are those of its labels. Raises InputError for
    a single day.
    """
    learned_set, *further_sets = (views for views, _ in in_order(days, places))
    if not further_sets:
        raise InputError(
            "from: the model knows the only sequence already; name the further ones after it"
        )
    for number, day_set in enumerate(further_sets, 1):
        model = method.grow(model, learned_set, day_set, progress.part(f"day{number}"))
        learned_set = TrainingSet.joined([learned_set, day_set])
    return model, learned_set
