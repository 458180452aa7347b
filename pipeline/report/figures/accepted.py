"""One test day of a model: where it placed each scan, and whether that was accepted.

In: a study, a model and a test sequence. Out: an `AcceptedDrive`, which the moving picture shows.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError
from pipeline.core.frames import Poses, distance_and_turn, transformed
from pipeline.evaluation.evaluations import Evaluations
from pipeline.evaluation.failures import unperturbed
from pipeline.evaluation.numbers import within
from pipeline.report.result import day
from pipeline.report.study import StudyResults

VOXEL_M = 0.6  # one of the map's points is drawn in each voxel of this side


@dataclass(frozen=True, eq=False)
class AcceptedDrive:
    """The q queries of a test day unperturbed, and the map that they were registered against."""

    where: str  # `simulated campus`
    model: str
    trained: str  # the training day, or several
    driven: str  # the test day
    days: int  # whole days from training to test; negative if the test day is earlier
    simulated: bool
    posed: bool  # whether the answers are poses; else they are places
    target_precision: float | None  # at which poses are accepted; None if none can be reached
    map_m: NDArray[np.float64]  # (n, 3) what stood there at training, in the world
    world_T_true: Poses  # (q, 4, 4)
    world_T_query: Poses  # (q, 4, 4) NaN where there is no pose
    accepted: NDArray[np.bool_]  # (q,)
    # (q,) near enough to the true pose; for places: right, or not judged by the protocol
    right: NDArray[np.bool_]
    points_m: Callable[[int], NDArray[np.float64]]  # reads what a query saw standing (n, 3)

    @classmethod
    def of(
        cls, study: StudyResults, model: str, sequence: str, judged_precision: float = 0.99
    ) -> Self:
        """Read what a model answered on one test day.

        Poses are accepted at the highest target precision up to `judged_precision`. A model without
        poses puts a scan at the place that it names, with the true heading. Raises ArtifactError if
        an artifact is not built.
        """
        scans = study.drive(sequence)
        world_T_true = scans.world_T_anchor
        evaluation = study.artifact(Evaluations, "evaluate", sequence, model).case()
        posed = evaluation.has_poses
        if posed:
            fixes = store.read(study.find("localize", sequence, model), schemas.Fixes)
            poses, accepted, target_precision = verdicts(fixes, len(world_T_true), judged_precision)
            is_right = within(fixes.right_within, *distance_and_turn(poses, world_T_true))
        else:
            acceptance = evaluation.acceptance
            accepted = acceptance["accepted"]
            # Queries that are not judged are in none of these, so they count as right.
            is_right = ~(acceptance["accepted_wrong"] | acceptance["refused_wrong"])
            target_precision = None
            poses = world_T_true.copy()
            poses[:, :2, 3] = evaluation.answer_xy_m
        map_m = study.trained_m()
        _, first = np.unique(np.floor(map_m / VOXEL_M), axis=0, return_index=True)
        return cls(
            where=study.where,
            model=model,
            trained=" and ".join(map(day, study.train.split())),
            driven=day(sequence),
            days=evaluation.days,
            simulated=study.simulated,
            posed=posed,
            target_precision=target_precision,
            map_m=map_m[np.sort(first)],
            world_T_true=world_T_true,
            world_T_query=poses,
            accepted=accepted,
            right=is_right,
            points_m=scans.standing_m,
        )

    @property
    def title(self) -> str:
        """The days: `Learned 2012-01-15, driven 2013-04-05, 446 days later`."""
        when = "the same day"
        if self.days:
            between = "1 day" if abs(self.days) == 1 else f"{abs(self.days)} days"
            when = f"{between} {'later' if self.days > 0 else 'earlier'}"
        return f"Learned {self.trained}, driven {self.driven}, {when}"

    @property
    def counts(self) -> NDArray[np.int64]:
        """Counts up to each query (4, q).

        The rows count queries that are accepted, accepted and wrong, refused, refused and wrong.
        """
        has_pose = np.isfinite(self.world_T_query).all(axis=(1, 2))
        counted = (
            self.accepted,
            self.accepted & ~self.right,
            ~self.accepted,
            ~self.accepted & ~self.right & has_pose,
        )
        return np.cumsum(counted, axis=1)

    def placed_points_m(self, query: int) -> NDArray[np.float64]:
        """The standing points (n, 3) of a query, placed in the world by its pose, if it has one."""
        pose = self.world_T_query[query]
        if not np.isfinite(pose).all():
            return np.empty((0, 3))
        return transformed(pose, self.points_m(query))


def verdicts(
    fixes: schemas.Fixes, count: int, judged_precision: float
) -> tuple[Poses, NDArray[np.bool_], float | None]:
    """The poses (count, 4, 4) of unperturbed queries, and which poses are accepted (count,).

    Also returns the target precision: the highest up to `judged_precision` that has a threshold. If
    none has, no pose is accepted, and it is None. Raises ArtifactError unless there are `count`
    poses.
    """
    rows = unperturbed(fixes, count)
    world_T_query = fixes.load("world_T_query")[rows]
    if len(world_T_query) != count:
        raise ArtifactError(
            f"{fixes.path}: {len(world_T_query)} poses of {count} submaps; `dvc repro` it"
        )
    novelty = fixes.load("novelty")[rows, 0].astype(np.float64)
    has_pose = np.isfinite(world_T_query).all(axis=(1, 2))
    accepted = has_pose & (novelty < fixes.reject_from(judged_precision))
    return world_T_query, accepted, fixes.kept_precision(judged_precision)
