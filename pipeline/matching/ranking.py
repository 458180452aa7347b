"""The waist: the views that every method is asked about, and the ranking that it answers with."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Case, read_cases
from pipeline.core import schemas, store
from pipeline.core.errors import InputError
from pipeline.core.frames import Poses, Stamps
from pipeline.core.progress import Progress
from pipeline.core.schemas import Ranking as Ranking

Model = Mapping[str, NDArray[Any]]
"""What a method learned: named arrays, among them the evidence of its held-out blocks
(matching.rejection)."""


@dataclass(frozen=True)
class Rows:
    """A window on a view artifact, a row a submap."""

    images: Any
    """(submap, …) such as (submap, ring, sector) heights in metres; schemas.VIEW_KINDS says what
    else; slicing reads."""
    stamps_ns: Stamps
    world_T_anchor: Poses

    @classmethod
    def read(cls, path: str | Path) -> Self:
        """Open a view artifact of a single case."""
        ((_, rows),) = cls.cases(path).items()
        return rows

    @classmethod
    def cases(cls, path: str | Path) -> dict[Case, Self]:
        """The rows of each case of a view artifact."""
        views = store.read(path, *schemas.VIEW_KINDS)
        cases = read_cases(views.cases)
        all_rows = cls(views["images"], views.stamps_ns, views.world_T_anchor)
        n = len(all_rows.stamps_ns) // len(cases)
        if len(cases) == 1:
            return {cases[0]: all_rows}
        return {case: all_rows.some(slice(i * n, (i + 1) * n)) for i, case in enumerate(cases)}

    def some(self, rows: slice) -> Self:
        """A slice of the rows, with their images read."""
        return replace(
            self,
            images=self.images[rows],
            stamps_ns=self.stamps_ns[rows],
            world_T_anchor=self.world_T_anchor[rows],
        )

    @classmethod
    def queries(cls, as_driven: Path, altered: Iterable[Path]) -> dict[Case, Self]:
        """The queries of a sequence as driven, then its altered cases where artifacts exist."""
        cases = cls.cases(as_driven)
        for path in altered:
            cases |= cls.cases(path) if path.is_dir() else {}
        return cases

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The rows of several sequences, one after the other."""
        if len(parts) == 1:
            return parts[0]
        columns = zip(
            *((part.images[:], part.stamps_ns, part.world_T_anchor) for part in parts), strict=True
        )
        return cls(*map(np.concatenate, columns))


class TrainingSet(NamedTuple):
    """Views of one or several drives, in the order in which they were learned."""

    views: Rows
    places: NDArray[np.int64]
    """(submap,) the place of each; new places of a later set follow those that are known."""

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


Localizer = Callable[[Rows, int], Ranking]  # ranks the k likeliest places of each view


def joined(rankings: Sequence[Ranking]) -> Ranking:
    """The rows of several rankings of one model, one after the other."""
    names = [name for name in vars(rankings[0]) if name != "kinds"]
    columns: dict[str, Any] = {
        name: np.concatenate([getattr(ranking, name) for ranking in rankings]) for name in names
    }
    return replace(rankings[0], **columns)


def joined_places(parts: Sequence[NDArray[np.int64]]) -> NDArray[np.int64]:
    """Places of several sequences, none of which shares a place with another."""
    firsts = np.cumsum([0, *(part.max() + 1 for part in parts[:-1])])
    return np.concatenate([part + offset for part, offset in zip(parts, firsts, strict=True)])


class Method(Protocol):
    """One file in pipeline/methods; its fields are the keys of its yaml."""

    view: str

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Learn the training sequence's views, whose places (submap,) are all known."""

    def grow(
        self, model: Model, known_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """Add views of further days to a model of `known_set`, whose places keep their numbers."""

    def localizer(self, model: Model) -> Localizer:
        """Make a function that ranks views with the model; it runs in one thread at a time."""
