"""One test day of a model with poses: where each scan was laid, and whether that was believed."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.alterations import Case, read_cases
from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError
from pipeline.core.frames import Poses, apart
from pipeline.evaluation.judgement import Evaluations
from pipeline.evaluation.numbers import within
from pipeline.mapping.gathering import submap_points
from pipeline.posing.registration import Points
from pipeline.posing.targets import Targets
from pipeline.report.figures.drive import titled
from pipeline.report.result import day
from pipeline.report.study import Study

WALL_M = (0.8, 12.0)
"""Heights above the ground of the points that are drawn."""
VOXEL_M = 0.6
"""One map point is drawn of each voxel."""


@dataclass(frozen=True, eq=False)
class BelievedDrive:
    """The q queries of a test day as driven, and the map that they were registered against."""

    where: str  # `simulated campus`
    model: str
    trained: str  # the training day, or several
    driven: str  # the test day
    days: int  # whole days between them
    simulated: bool
    promise: float | None  # that the verdict keeps; None where no precision can be promised
    map_m: NDArray[np.float64]  # (n, 3) what stood there at training, in the world
    world_T_true: Poses  # (q, 4, 4)
    world_T_query: Poses  # (q, 4, 4) NaN where there is no pose
    accepted: NDArray[np.bool_]  # (q,)
    right: NDArray[np.bool_]  # (q,) near enough to the true pose
    points_m: Callable[[int], Points]  # reads the points (n, 3) of a query, ground at z = 0

    @classmethod
    def of(cls, study: Study, model: str, sequence: str, wanted_promise: float = 0.99) -> Self:
        """Read what a model answered on one test day, by the highest promise up to the wanted one.

        Raises ArtifactError where it is not built.
        """
        fixes = store.read(study.find("localize", sequence, model), schemas.Fixes)
        scans = study.artifact(schemas.Scans, "scans", sequence)
        submaps = study.artifact(schemas.Submaps, "submaps", sequence)
        world_T_true = submaps.load("world_T_anchor")
        world_T_query, accepted, promise = verdicts(fixes, len(world_T_true), wanted_promise)
        maps = [study.find("map", train_sequence) for train_sequence in study.train.split()]
        return cls(
            where=study.where,
            model=model,
            trained=" and ".join(map(day, study.train.split())),
            driven=day(sequence),
            days=study.artifact(Evaluations, "evaluate", sequence, model).case().days,
            simulated=study.simulated,
            promise=promise,
            map_m=np.concatenate([standing(Targets.read(path)) for path in maps]),
            world_T_true=world_T_true,
            world_T_query=world_T_query,
            accepted=accepted,
            right=within(fixes.right_within, *apart(world_T_query, world_T_true)),
            points_m=partial(_points, scans, submaps),
        )

    @property
    def title(self) -> str:
        """The days: `Learned 2012-01-15, driven 2013-04-05, 446 days later`."""
        return titled(self.trained, self.driven, self.days)

    @property
    def counts(self) -> NDArray[np.int64]:
        """How many queries up to each one (4, q): accepted, wrong ones, refused, wrong ones."""
        kinds = [self.accepted, self.accepted & ~self.right]
        placed = np.isfinite(self.world_T_query).all(axis=(1, 2))
        kinds += [~self.accepted, ~self.accepted & ~self.right & placed]
        return np.cumsum(kinds, axis=1)

    def walls_m(self, query: int) -> NDArray[np.float64]:
        """The points (n, 3) of a query that are no ground, in the world where it was laid.

        None without a pose.
        """
        pose = self.world_T_query[query]
        if not np.isfinite(pose).all():
            return np.empty((0, 3))
        walls_m = _walls(self.points_m(query))
        return np.asarray(walls_m @ pose[:3, :3].T + pose[:3, 3])


def verdicts(
    fixes: schemas.Fixes, count: int, wanted_promise: float
) -> tuple[Poses, NDArray[np.bool_], float | None]:
    """The poses (count, 4, 4) of queries as driven, which are accepted, and what that promises.

    The promise is the highest up to the wanted one; without any, none is accepted. Raises
    ArtifactError for another number of poses.
    """
    driven = read_cases(fixes.cases).index(Case())
    rows = slice(driven * count, (driven + 1) * count)
    world_T_query = fixes.load("world_T_query")[rows]
    if len(world_T_query) != count:
        raise ArtifactError(
            f"{fixes.path}: {len(world_T_query)} poses of {count} submaps; `dvc repro` it"
        )
    limits = {
        promise: reject_from
        for promise, reject_from in zip(fixes.promises, fixes.promised, strict=True)
        if reject_from > 0 and promise <= wanted_promise
    }
    if not limits:
        return world_T_query, np.zeros(count, bool), None
    promise = max(limits)
    doubt = fixes.load("novelty")[rows, 0].astype(np.float64)
    placed = np.isfinite(world_T_query).all(axis=(1, 2))
    return world_T_query, placed & (doubt < limits[promise]), promise


def standing(targets: Targets) -> NDArray[np.float64]:
    """The points (n, 3) of a map that are no ground, in the world, one a voxel."""
    points_m = np.concatenate(list(_in_world(targets)))
    voxels = np.floor(points_m / VOXEL_M).astype(np.int64)
    _, first = np.unique(voxels, axis=0, return_index=True)
    return points_m[np.sort(first)]


def _points(scans: schemas.Scans, submaps: schemas.Submaps, query: int) -> Points:
    return next(iter(submap_points(scans, submaps, slice(query, query + 1))))


def _in_world(targets: Targets) -> Iterator[NDArray[np.float64]]:
    for row, pose in enumerate(targets.world_T_anchor):
        yield _walls(targets.points_m(row)) @ pose[:3, :3].T + pose[:3, 3]


def _walls(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return points_m[(points_m[:, 2] > WALL_M[0]) & (points_m[:, 2] < WALL_M[1])]
