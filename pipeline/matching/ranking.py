"""The interface of all methods: views in, a ranking of places out.

Every method (`Method`) learns a model from the views of the training sequence, and makes from it a
function (`Localizer`) that answers queries with a `Ranking`. The steps before depend on the data
set; the steps after are the same for all methods.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.errors import InputError
from pipeline.core.frames import Poses, Stamps
from pipeline.core.progress import Progress
from pipeline.core.schemas import Ranking as Ranking
from pipeline.perturbations import Case, read_cases

Model = Mapping[str, NDArray[Any]]
"""What a method learned: named arrays. They include the evidence of validation blocks, from which
thresholds are chosen (`matching.rejection`)."""


@dataclass(frozen=True)
class Rows:
    """The views of some submaps, one row per submap: a window on a view artifact."""

    images: Any
    """(submap, …) such as heights (submap, ring, sector) in metres; `schemas.VIEW_KINDS` lists all
    kinds. An array in memory, or an array in a file of which only slices are read."""
    stamps_ns: Stamps
    """(submap,) the stamp of each submap's anchor, the scan around which it is gathered."""
    world_T_anchor: Poses
    """(submap, 4, 4) the pose of each anchor."""

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Open a view artifact that has a single case."""
        ((_, rows),) = cls.cases(path).items()
        return rows

    @classmethod
    def cases(cls, path: str | Path) -> dict[Case, Self]:
        """Open a view artifact; returns the rows of each of its cases.

        A case is one way in which queries are perturbed; the artifact holds the cases one after the
        other.
        """
        views = store.read(path, *schemas.VIEW_KINDS)
        cases = read_cases(views.cases)
        all_rows = cls(views["images"], views.stamps_ns, views.world_T_anchor)
        n = len(all_rows.stamps_ns) // len(cases)
        if len(cases) == 1:
            return {cases[0]: all_rows}
        return {case: all_rows.select(slice(i * n, (i + 1) * n)) for i, case in enumerate(cases)}

    def select(self, rows: slice | NDArray[np.int64]) -> Self:
        """Return some of the rows, with their images read."""
        return replace(
            self,
            images=self.images[rows],
            stamps_ns=self.stamps_ns[rows],
            world_T_anchor=self.world_T_anchor[rows],
        )

    @classmethod
    def queries(cls, unperturbed: Path, perturbed: Iterable[Path]) -> dict[Case, Self]:
        """Open a sequence's unperturbed queries, and the perturbed queries of files that exist."""
        cases = cls.cases(unperturbed)
        for path in perturbed:
            if path.is_dir():
                cases |= cls.cases(path)
        return cases

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The rows of several sequences, one after the other."""
        if len(parts) == 1:
            return parts[0]
        return cls(
            np.concatenate([part.images[:] for part in parts]),
            np.concatenate([part.stamps_ns for part in parts]),
            np.concatenate([part.world_T_anchor for part in parts]),
        )


class TrainingSet(NamedTuple):
    """Views of one or several drives, in the order in which they were learned."""

    views: Rows
    places: NDArray[np.int64]
    """(submap,) the place of each view; new places of a later set get the next numbers."""

    def __len__(self) -> int:
        return len(self.places)

    @classmethod
    def joined(cls, sets: Sequence[Self]) -> Self:
        """Several sets as one; raises InputError unless every place from 0 on has a view."""
        views = Rows.joined([part.views for part in sets])
        places = np.concatenate([part.places for part in sets])
        if not len(places) or len(places) != len(views.world_T_anchor) or (places < 0).any():
            raise InputError("every view of the training sequence needs a known place")
        if missing := np.flatnonzero(np.bincount(places) == 0).tolist():
            raise InputError(f"place {missing[0]} of {places.max() + 1} has no view")
        return cls(views, places.astype(np.int64))


Localizer = Callable[[Rows, int], Ranking]
"""Takes views and k; ranks the k likeliest places of each view."""


def joined(rankings: Sequence[Ranking]) -> Ranking:
    """Several rankings of one model as one, with their rows one after the other."""
    names = [name for name in vars(rankings[0]) if name != "kinds"]
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(ranking, name) for ranking in rankings]) for name in names
    }
    return replace(rankings[0], **columns)


def joined_places(parts: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Number the places of several sequences as if the sequences had no place in common."""
    joined_parts = []
    first_place = 0
    for part in parts:
        joined_parts.append(part + first_place)
        first_place += part.max() + 1
    return np.concatenate(joined_parts)


class Method(Protocol):
    """The interface of a method: one file in pipeline/methods, with its yaml's keys as fields."""

    view: str
    """The name of the view that it uses, a file in conf/view."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Learn a model from the training views, whose places (submap,) are all known."""

    def extend(
        self, model: Model, known_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """Add the views of `new_set` to a model of `known_set`, whose places keep their numbers."""

    def localizer(self, model: Model) -> Localizer:
        """Make a function that ranks views with the model; it runs in one thread at a time."""
