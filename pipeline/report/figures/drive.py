"""One test day as a model answered it, query by query: the data of the moving picture."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError
from pipeline.core.frames import yaw
from pipeline.evaluation.judgement import Evaluations
from pipeline.mapping.gathering import submap_points
from pipeline.report.alike import best_shifts, spectra
from pipeline.report.result import day
from pipeline.report.study import Study

RIGHT, WRONG, NOT_COUNTED = range(3)
WALL_M = (2.0, 6.0)
"""Heights above the ground of the points that show what stands there."""
LOOKS = 150
CELLS = 300
FEWEST = 4
"""Submaps of training whose points are taken, cells along the longer side of the site, points of a
cell that holds a wall."""


@dataclass(frozen=True, eq=False)
class Views:
    """Scan Contexts, heights in metres."""

    queries: NDArray[np.float32]  # (q, ring, sector)
    training: NDArray[np.float32]  # (n, ring, sector)


@dataclass(frozen=True, eq=False)
class Drive:
    """The q queries of a test day as driven, beside the n submaps of training."""

    where: str  # `simulated campus`
    model: str
    trained: str  # the training day, or several
    driven: str  # the test day
    days: int  # whole days between them
    simulated: bool
    correct_m: float  # an answer is right at most so far from its query
    seen_m: float  # and a query counts where training was nearer than this
    # (w, 2) what stood there at training; none where its scans are gone
    walls_xy_m: NDArray[np.float64]
    train_xy_m: NDArray[np.float64]  # (n, 2)
    xy_m: NDArray[np.float64]  # (q, 2)
    heading_rad: NDArray[np.float64]  # (q,) counter-clockwise from +x
    answer_xy_m: NDArray[np.float64]  # (q, 2) NaN where there is none
    outcome: NDArray[np.int64]  # (q,) RIGHT, WRONG, or NOT_COUNTED
    views: Views | None  # of a method that looks at Scan Contexts

    @classmethod
    def of(cls, study: Study, model: str, sequence: str) -> Self:
        """Read what a model answered on one test day; raises ArtifactError if it is not built."""
        artifact = study.artifact(Evaluations, "evaluate", sequence, model)
        evaluation = artifact.case()
        rules = artifact.distance
        looked_at = store.read(study.find("views", sequence, model), *schemas.VIEW_KINDS)
        views = None
        if isinstance(looked_at, schemas.ScanContextViews):
            training_images = [
                store.read(
                    study.find("views", train_sequence, model), schemas.ScanContextViews
                ).load("images")
                for train_sequence in study.train.split()
            ]
            views = Views(looked_at.load("images"), np.concatenate(training_images))
        heading_rad = yaw(looked_at.load("world_T_anchor"))
        if not len(evaluation.xy_m) == len(heading_rad) > 0:
            raise ArtifactError(
                f"{artifact.path}: {len(evaluation.xy_m)} queries of {len(heading_rad)} views; "
                "`dvc repro` it"
            )
        right = np.where(evaluation.distance.true_rank == 0, RIGHT, WRONG)
        return cls(
            where=study.where,
            model=model,
            trained=" and ".join(map(day, study.train.split())),
            driven=day(sequence),
            days=evaluation.days,
            simulated=study.simulated,
            correct_m=rules["correct_m"],
            seen_m=rules["seen_m"],
            walls_xy_m=np.concatenate(
                [walls(study, train_sequence) for train_sequence in study.train.split()]
            ),
            train_xy_m=study.train_xy_m,
            xy_m=evaluation.xy_m,
            heading_rad=heading_rad,
            answer_xy_m=evaluation.answer_xy_m,
            outcome=np.where(evaluation.distance.seen, right, NOT_COUNTED),
            views=views,
        )

    @property
    def title(self) -> str:
        """The days: `Learned 2012-01-15, driven 2013-04-05, 446 days later`."""
        return titled(self.trained, self.driven, self.days)

    @property
    def driven_m(self) -> NDArray[np.float64]:
        """Metres (q,) driven from the first query to each, in straight lines between queries."""
        steps_m = np.linalg.norm(np.diff(self.xy_m, axis=0), axis=1)
        return np.concatenate([[0.0], np.cumsum(steps_m)])

    @property
    def counted(self) -> NDArray[np.int64]:
        """How many of the queries up to each one count, and how many of them are right: (2, q)."""
        return np.cumsum([self.outcome != NOT_COUNTED, self.outcome == RIGHT], axis=1)

    @property
    def error_m(self) -> NDArray[np.float64]:
        """Metres (q,) from each query to its answer, NaN where there is none."""
        error_m: NDArray[np.float64] = np.linalg.norm(self.answer_xy_m - self.xy_m, axis=1)
        return error_m

    def pairs(self, views: Views, queries: NDArray[np.int64]) -> NDArray[np.float32]:
        """Heights (query, 2, ring, sector) of queries and of the training views of their answers.

        The training view is nearest to the answer and rolled to look most like the query; NaN where
        there is no answer.
        """
        query_views = views.queries[queries]
        sectors = views.queries.shape[2]
        has_answer = np.isfinite(self.answer_xy_m[queries]).all(axis=1)
        matched = np.full(query_views.shape, np.nan, np.float32)
        if has_answer.any():
            answer_views = views.training[
                KDTree(self.train_xy_m).query(self.answer_xy_m[queries[has_answer]])[1]
            ]
            shifts = best_shifts(spectra(query_views[has_answer]), spectra(answer_views), sectors)
            columns = (np.arange(sectors) - shifts[:, None]) % sectors
            matched[has_answer] = np.take_along_axis(answer_views, columns[:, None], axis=2)
        return np.stack([query_views, matched], axis=1)


def titled(trained: str, driven: str, days: int) -> str:
    """The days: `Learned 2012-01-15, driven 2013-04-05, 446 days later`."""
    between = f"{abs(days)} day{'s' * (abs(days) != 1)} {'later' if days > 0 else 'earlier'}"
    return f"Learned {trained}, driven {driven}, {between if days else 'the same day'}"


def walls(study: Study, sequence: str) -> NDArray[np.float64]:
    """Centres (w, 2) of the site's cells with points well above the ground, on one training day."""
    submaps = study.artifact(schemas.Submaps, "submaps", sequence)
    try:
        scans = study.artifact(schemas.Scans, "scans", sequence)
    except ArtifactError:
        return np.empty((0, 2))
    world_T_anchor = submaps.load("world_T_anchor")
    wall_points = []
    for row in np.unique(
        np.linspace(0, len(world_T_anchor) - 1, LOOKS).round().astype(int)
    ).tolist():
        points_m = next(iter(submap_points(scans, submaps, slice(row, row + 1))))
        points_m = points_m[(points_m[:, 2] > WALL_M[0]) & (points_m[:, 2] < WALL_M[1])]
        wall_points.append(
            points_m[:, :2] @ world_T_anchor[row, :2, :2].T + world_T_anchor[row, :2, 3]
        )
    cell_m = float(np.ptp(study.train_xy_m, axis=0).max()) / CELLS + 0.2
    cells, counts = np.unique(
        np.floor(np.concatenate(wall_points) / cell_m), axis=0, return_counts=True
    )
    return np.asarray((cells[counts >= max(FEWEST, np.median(counts))] + 0.5) * cell_m)
