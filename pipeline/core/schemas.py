"""The data dictionary: every artifact, its arrays and attributes, their dimensions and units.

Two kinds live in `pipeline.evaluation`, beside their functions: Evaluations and ViewpointMatches.
docs/artifacts.md is generated from these definitions.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.store import Array, Artifact

SINCE_1970 = "nanoseconds since 1970-01-01"
"""As xarray and CF name the unit of a stamp."""

PoseColumn = Literal["odom_T_scan", "world_T_scan"]
"""The column of Scans whose poses lay the scans of a submap out around its anchor."""


@dataclass(frozen=True, eq=False)
class Scans(Artifact, kind="scans", version=2):
    """The scans of one sequence with their poses; sweeps, of a 2-D LiDAR."""

    points: Annotated[
        NDArray[np.int16],
        Array(
            ("point", "xyz"),
            "in units of grain_m, vehicle frame (x forward, y left, z up)",
            unit="grain_m",
            chunk=32_768,
        ),
    ]
    offsets: Annotated[
        NDArray[np.int64],
        Array(("scan+1",), "scan (or sweep) i is points[offsets[i]:offsets[i + 1]]"),
    ]
    stamps_ns: Annotated[NDArray[np.int64], Array(("scan",), "when it was taken", unit=SINCE_1970)]
    world_T_scan: Annotated[
        NDArray[np.float64],
        Array(
            ("scan", "row", "col"),
            "ground truth at the stamp; NaN where odometry alone is known",
            unit="m",
        ),
    ]
    odom_T_scan: Annotated[
        NDArray[np.float64],
        Array(
            ("scan", "row", "col"),
            "the log's own odometry at the stamp; NaN where it has none",
            unit="m",
        ),
    ]
    odom_variance: Annotated[
        NDArray[np.float64],
        Array(
            ("scan", "gathered"),
            "variance that the odometry says it gathered since its start: of the position (mean of "
            "x and y), of the heading; NaN where it says nothing",
            unit="m², rad²",
        ),
    ]
    grain_m: Annotated[float, "metres per unit of points"]
    skipped: Annotated[Mapping[str, int], "scans of the log that are not here: reason to count"]
    clipped: Annotated[int, "points beyond the 16-bit range that were dropped"]


@dataclass(frozen=True, eq=False)
class Estimates(Artifact, kind="slam", version=1):
    """The poses of one log by its scans alone."""

    stamps_ns: Annotated[NDArray[np.int64], Array(("scan",), "when it was taken", unit=SINCE_1970)]
    odom_T_scan: Annotated[
        NDArray[np.float64],
        Array(
            ("scan", "row", "col"), "by registration, before any loop; anew after a break", unit="m"
        ),
    ]
    world_T_scan: Annotated[
        NDArray[np.float64],
        Array(
            ("scan", "row", "col"),
            "the result; NaN of scans that are not joined with the longest part, or with the map",
            unit="m",
        ),
    ]
    overlap: Annotated[
        NDArray[np.float64],
        Array(
            ("scan",),
            "share of what stands in this scan that the one before has too, or the other way "
            "round: the larger of the two",
        ),
    ]
    by_log: Annotated[
        NDArray[np.bool_], Array(("scan",), "the step to it is the log's own odometry")
    ]
    breaks: Annotated[
        NDArray[np.int64], Array(("break",), "scans that nothing joins with the one before")
    ]
    fixed: Annotated[
        NDArray[np.int64], Array(("fix",), "scans that were found on the training sequence's map")
    ]
    earlier: Annotated[NDArray[np.int64], Array(("loop",), "the earlier scan of a loop")]
    later: Annotated[NDArray[np.int64], Array(("loop",), "the later scan of a loop")]
    earlier_T_later: Annotated[
        NDArray[np.float64],
        Array(("loop", "row", "col"), "the later scan's pose in the earlier one's frame", unit="m"),
    ]
    residual_m: Annotated[
        NDArray[np.float64], Array(("loop",), "between that pose and the result", unit="m")
    ]
    residual_deg: Annotated[
        NDArray[np.float64], Array(("loop",), "between that pose and the result", unit="degree")
    ]
    used: Annotated[NDArray[np.bool_], Array(("loop",), "False of a loop that the others overrule")]
    skipped: Annotated[Mapping[str, int], "scans without a pose: reason to count"]

    @property
    def path_m(self) -> NDArray[np.float64]:
        """Metres of path (scan,) driven until each; breaks and scans without odometry add none."""
        steps_m = np.linalg.norm(np.diff(self.odom_T_scan[:, :3, 3], axis=0), axis=1)
        steps_m[self.breaks - 1] = 0.0
        return np.concatenate([[0.0], np.cumsum(np.where(np.isfinite(steps_m), steps_m, 0.0))])

    @property
    def posed(self) -> NDArray[np.bool_]:
        """Which scans (scan,) have a pose."""
        return np.asarray(np.isfinite(self.world_T_scan).all(axis=(1, 2)))


@dataclass(frozen=True, eq=False)
class Submaps(Artifact, kind="submaps", version=3):
    """The submaps of one sequence, in order of time.

    A submap gathers the scans `first` to `scans`, both included.
    """

    first: Annotated[
        NDArray[np.int64],
        Array(("submap",), "the oldest scan that it gathers: a row of the scans artifact"),
    ]
    scans: Annotated[
        NDArray[np.int64], Array(("submap",), "the newest, whose frame is the anchor's")
    ]
    ground_m: Annotated[
        NDArray[np.float64],
        Array(
            ("submap",),
            "height of the ground in that frame, taken off all heights",
            unit="m",
        ),
    ]
    used: Annotated[
        NDArray[np.bool_], Array(("scan",), "scans that go into the submaps around them")
    ]
    stamps_ns: Annotated[NDArray[np.int64], Array(("submap",), "of the anchor", unit=SINCE_1970)]
    world_T_anchor: Annotated[
        NDArray[np.float64],
        Array(("submap", "row", "col"), "ground truth of the anchor", unit="m"),
    ]
    layout: Annotated[
        PoseColumn, "the column of the scans artifact whose poses lay a submap's scans out"
    ]
    left_out: Annotated[Mapping[str, int], "anchors that make no submap: reason to count"]
    appearance: Annotated[
        Mapping[str, float],
        "medians over a few submaps: azimuth_deg, degrees around with points; ground_m and "
        "highest_m, z of the ground and of the top; null if there is none",
    ]


Cases = Annotated[
    Sequence[Mapping[str, Any]],
    "what was done to the queries, such as turned: change, level, shadow, repeat; a row a submap "
    "in each, case after case",
]


@dataclass(frozen=True, eq=False)
class Views(Artifact):
    """What a method looks at: an image of each submap, in each case.

    Artifacts of the stages views, birdviews and altered; the kinds differ in their images.
    """

    images: NDArray[Any]
    stamps_ns: Annotated[NDArray[np.int64], Array(("submap",), "of the anchor", unit=SINCE_1970)]
    world_T_anchor: Annotated[
        NDArray[np.float64],
        Array(
            ("submap", "row", "col"),
            "true pose of the anchor, turned as the robot is in each case",
            unit="m",
        ),
    ]
    cases: Cases


@dataclass(frozen=True, eq=False)
class ScanContextViews(Views, kind="views", version=2):
    """Scan Context: the highest point of each bin around the robot."""

    images: Annotated[
        NDArray[np.float32],
        Array(
            ("submap", "ring", "sector"),
            "highest z, 0 where empty",
            unit="m",
            chunk=32,
            shard=2_048,
        ),
    ]


@dataclass(frozen=True, eq=False)
class CloudViews(Views, kind="clouds", version=2):
    """Points in a cube around the robot, for networks on clouds."""

    images: Annotated[
        NDArray[np.float16],
        Array(
            ("submap", "point", "xyz"),
            "about their mean, in units of the cube's half side",
            chunk=16,
            shard=512,
        ),
    ]


@dataclass(frozen=True, eq=False)
class SignatureViews(Views, kind="signatures", version=2):
    """Descriptors that need no training."""

    images: Annotated[
        NDArray[np.float32],
        Array(("submap", "number"), "a descriptor that needs no training", chunk=512, shard=4_096),
    ]


@dataclass(frozen=True, eq=False)
class BirdViews(Views, kind="birdviews", version=2):
    """The octree of the scans so far, seen from above at several headings."""

    images: Annotated[
        NDArray[np.uint8],
        Array(
            ("submap", "heading", "row_px", "col_px"),
            "occupied share of 255, front up, left left",
            chunk=16,
            shard=512,
        ),
    ]


VIEW_KINDS = (ScanContextViews, CloudViews, SignatureViews, BirdViews)


@dataclass(frozen=True, eq=False)
class Labels(Artifact, kind="labels", version=1):
    """The places of a sequence's submaps, and what its nearest training anchors say."""

    places: Annotated[
        NDArray[np.int64],
        Array(("submap",), "place id of the anchor's cell; −1 where training never went"),
    ]
    cells: Annotated[
        NDArray[np.int64], Array(("place",), "grid cell of each place, x-major, ascending")
    ]
    oracle: Annotated[
        NDArray[np.int64],
        Array(
            ("submap",),
            "place of the geometrically nearest training anchor: the best that can be answered",
        ),
    ]
    nearest_m: Annotated[
        NDArray[np.float64],
        Array(("submap",), "distance to that anchor in the xy plane", unit="m"),
    ]
    nearest_turn_deg: Annotated[
        NDArray[np.float64],
        Array(("submap",), "heading against that anchor's, in (−180, 180]", unit="degree"),
    ]
    days: Annotated[int, "whole days from the training sequence's date to this one's"]
    cell_m: Annotated[float, "wanted side of a cell in metres"]
    x_m: Annotated[tuple[float, float], "the grid's box along x: lowest, highest"]
    y_m: Annotated[tuple[float, float], "the grid's box along y: lowest, highest"]


@dataclass(frozen=True, eq=False)
class Ranking:
    """A method's answer to queries: k places each, cheapest first, and their novelty."""

    places: Annotated[NDArray[np.int64], Array(("query", "rank"), "places, cheapest first")]
    costs: Annotated[
        NDArray[np.float32], Array(("query", "rank"), "cost of each, smaller is better")
    ]
    xy_m: Annotated[
        NDArray[np.float64],
        Array(
            ("query", "rank", "xy"),
            "where each answer lies in the world: the matched training row, or the place's mean",
            unit="m",
        ),
    ]
    novelty: Annotated[
        NDArray[np.float32],
        Array(("query", "kind"), "larger: more likely unseen; the first kind is the one in use"),
    ]
    confidence: Annotated[
        NDArray[np.float32],
        Array(("query",), "chance that the first place is right; NaN where the method gives none"),
    ]
    heading_deg: Annotated[
        NDArray[np.float32],
        Array(
            ("query", "rank"),
            "the query's yaw in the world, in (−180, 180], if that answer is right; NaN where the "
            "method cannot tell",
            unit="degree",
        ),
    ]
    kinds: Annotated[tuple[str, ...], "name of each kind of novelty"]

    def checked(self, n: int) -> Self:
        """The ranking itself; raises InputError unless its arrays have the shapes of `n` queries.

        So does a novelty that is NaN.
        """
        k = self.places.shape[-1]
        shapes = {
            "places": (n, k),
            "costs": (n, k),
            "xy_m": (n, k, 2),
            "novelty": (n, len(self.kinds)),
            "confidence": (n,),
            "heading_deg": (n, k),
        }
        for name, shape in shapes.items():
            if getattr(self, name).shape != shape:
                raise InputError(
                    f"the method answered {name} of shape {getattr(self, name).shape}: expected "
                    f"{shape}"
                )
        if np.isnan(self.novelty).any():
            raise InputError(
                f"the method's novelty is NaN for {np.isnan(self.novelty).any(1).sum()} of {n} "
                "queries"
            )
        return self

    def with_kind_first(self, kind: str) -> Self:
        """The ranking with this kind of novelty first."""
        first_column = self.kinds.index(kind)
        order = [
            first_column,
            *(column for column in range(len(self.kinds)) if column != first_column),
        ]
        return replace(
            self,
            novelty=self.novelty[:, order],
            kinds=tuple(self.kinds[column] for column in order),
        )


@dataclass(frozen=True, eq=False)
class SequenceRanking(Ranking, Artifact):
    """The ranking of one sequence's queries in every case, and when to reject one as unseen.

    Artifacts of the stages localize (Rankings), poses and paths (Fixes).
    """

    turned_deg: Annotated[
        NDArray[np.float32],
        Array(
            ("query",),
            "by how much the case turned the robot to the left, in (−180, 180]",
            unit="degree",
        ),
    ]
    cases: Cases
    thresholds: Annotated[
        tuple[float, ...],
        "reject as unseen from this novelty on, for each kind; chosen on held-out blocks of the "
        "training sequence",
    ]
    wanted_precision: Annotated[float, "the precision that they were chosen for"]

    def ranking(self, rows: slice = slice(None)) -> Ranking:
        """Some of the queries without what the artifact adds."""
        return Ranking(
            self.places[rows],
            self.costs[rows],
            self.xy_m[rows],
            self.novelty[rows],
            self.confidence[rows],
            self.heading_deg[rows],
            self.kinds,
        )


@dataclass(frozen=True, eq=False)
class Rankings(SequenceRanking, kind="rankings", version=5):
    """What a method answers."""

    kept_precision: Annotated[
        tuple[float, ...],
        "the precision that each threshold keeps on those blocks, wanted_precision or less; null "
        "of one that accepts nothing",
    ]


JUDGED_PROMISE = 0.99
"""The precision that accepted poses are to keep where they are judged, of those in `promises`."""


@dataclass(frozen=True, eq=False)
class Fixes(SequenceRanking, kind="fixes", version=5):
    """Rankings whose first answers were registered to poses; their first novelty doubts these."""

    world_T_query: Annotated[
        NDArray[np.float64],
        Array(
            ("query", "row", "col"),
            "the query's pose; NaN where it has too few points to tell",
            unit="m",
        ),
    ]
    covariance: Annotated[
        NDArray[np.float64],
        Array(
            ("query", "turn_step_row", "turn_step_col"),
            "of the pose's error, six numbers: a turn about x, y, z in radians, then a step along "
            "them in metres; NaN along a path",
        ),
    ]
    overlap: Annotated[
        NDArray[np.float32],
        Array(
            ("query",),
            "share of the query's voxels that the map has; that of its own fix along a path",
        ),
    ]
    promises: Annotated[tuple[float, ...], "precisions that a user may want"]
    promised: Annotated[
        tuple[float, ...],
        "reject from this novelty in use on to keep each of them, by held-out blocks of the "
        "training sequence",
    ]
    promised_place: Annotated[
        tuple[float, ...],
        "the same of the novelty `place`: the query is within 15 m of its pose",
    ]
    promised_several: Annotated[
        tuple[float, ...], "the same of the novelty `several`: one of its first poses is right"
    ]
    held_out: Annotated[
        int,
        "how many of those blocks there are, each asked as driven, aged, and without its "
        "surroundings",
    ]
    right_within: Annotated[
        tuple[float, float],
        "metres and degrees within which a pose is right: 2 and 5, of level sweeps 1 and 10",
    ]

    def reject_from(self, promise: float = JUDGED_PROMISE, belief: str = "fix") -> float:
        """The novelty from which to reject to keep a precision, one of `promises`.

        `belief` is what is rejected: the pose (`fix`), or that the query is near it (`place`), or
        that one of its first poses is right (`several`).
        """
        limits = {
            "fix": self.promised,
            "place": self.promised_place,
            "several": self.promised_several,
        }
        return limits[belief][self.promises.index(promise)]


@dataclass(frozen=True, eq=False)
class Maps(Artifact, kind="maps", version=1):
    """The training day's submaps, thinned, to register queries against."""

    points: Annotated[
        NDArray[np.int16],
        Array(
            ("point", "xyz"),
            "one a voxel, in grains, anchor's frame, z up from the ground",
            unit="grain_m",
            chunk=32_768,
        ),
    ]
    offsets: Annotated[
        NDArray[np.int64],
        Array(("submap+1",), "submap i is points[offsets[i]:offsets[i + 1]]"),
    ]
    world_T_anchor: Annotated[
        NDArray[np.float64],
        Array(("submap", "row", "col"), "true pose of each training submap's anchor", unit="m"),
    ]
    grain_m: Annotated[float, "metres per unit of points"]
    voxel_m: Annotated[float, "side of a voxel"]
    range_m: Annotated[float, "points farther from the anchor are left out"]
    single: Annotated[bool, "each submap is one scan, seen from one place"]


@dataclass(frozen=True, eq=False)
class Lifelong(Artifact, kind="lifelong", version=3):
    """What a localiser answers to all asked days after each step of learning."""

    right: Annotated[
        NDArray[np.bool_],
        Array(("step", "query"), "the first answer is the query's cell", chunk=8, shard=8),
    ]
    error_m: Annotated[
        NDArray[np.float64],
        Array(
            ("step", "query"),
            "distance from the query to the first answer",
            unit="m",
            chunk=8,
            shard=8,
        ),
    ]
    known_from: Annotated[
        NDArray[np.int64],
        Array(("query",), "the step from which its cell was surveyed; −1 for never"),
    ]
    day: Annotated[NDArray[np.int64], Array(("query",), "index of the asked day")]
    xy_m: Annotated[
        NDArray[np.float64], Array(("query", "xy"), "where the query was taken", unit="m")
    ]
    place_xy_m: Annotated[
        NDArray[np.float64],
        Array(("place", "xy"), "centre of each cell surveyed by the last step", unit="m"),
    ]
    newest_ns: Annotated[
        NDArray[np.int64],
        Array(
            ("place",),
            "stamp of its newest view that was surveyed or adopted",
            unit=SINCE_1970,
        ),
    ]
    order: Annotated[str, "days, streets or updates: what is learned in each step"]
    strategy: Annotated[str, "what a model does with it: a file of conf/strategy"]
    steps: Annotated[tuple[str, ...], "name of each step"]
    asked: Annotated[tuple[str, ...], "name of each asked day"]
    learned_ns: Annotated[tuple[int, ...], "stamp of the newest view after each step"]
    asked_ns: Annotated[tuple[int, ...], "first stamp of each asked day"]
    correct_m: Annotated[float, "right by distance: the answer is at most so far away"]
    places: Annotated[tuple[int, ...], "cells surveyed by each step"]
    bytes: Annotated[  # the name in the artifact; nothing here calls the built-in
        tuple[int, ...], "size of the model after each step"
    ]
    counts: Annotated[
        Sequence[Mapping[str, int]],
        "by each update: scans asked and adopted, adopted at a wrong pose, submaps that changed",
    ]
