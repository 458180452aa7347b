"""The data dictionary: every kind of artifact, with dimensions, unit and meaning of each array.

An artifact is what one stage of the chain writes for the next; `core.store` reads and writes it by
these classes: Scans, Estimates (poses by SLAM), Submaps, Views, Labels, Rankings, Fixes (poses of
queries), Maps, TiledMaps, Verdicts, Lifelong. Two further kinds are in `pipeline.evaluation`,
beside the functions that make them: Evaluations and ViewpointMatches. docs/artifacts.md is
generated from all of them.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.frames import travelled_m
from pipeline.core.precisions import JUDGED_PRECISION, kept_precision
from pipeline.core.store import Array, Artifact

SINCE_1970 = "nanoseconds since 1970-01-01"
"""The unit of stamps, in the words of xarray and the CF conventions."""

PoseColumn = Literal["odom_T_scan", "world_T_scan"]
"""The column of Scans with the poses by which a submap's scans are placed around its anchor."""


@dataclass(frozen=True, eq=False)
class Scans(Artifact, kind="scans", version=2):
    """The scans of one sequence, or the sweeps of a 2-D LiDAR, with their poses."""

    points: Annotated[
        NDArray[np.int16],
        Array(
            ("point", "xyz"),
            "all points, in the vehicle's frame (x forward, y left, z up), in units of grain_m",
            unit="grain_m",
            chunk=32_768,
        ),
    ]
    offsets: Annotated[
        NDArray[np.int64],
        Array(("scan+1",), "the points of scan i are points[offsets[i]:offsets[i + 1]]"),
    ]
    stamps_ns: Annotated[NDArray[np.int64], Array(("scan",), "when it was taken", unit=SINCE_1970)]
    world_T_scan: Annotated[
        NDArray[np.float64],
        Array(
            ("scan", "row", "col"),
            "true pose at the stamp; NaN where only odometry is known",
            unit="m",
        ),
    ]
    odom_T_scan: Annotated[
        NDArray[np.float64],
        Array(
            ("scan", "row", "col"),
            "pose by the log's own odometry at the stamp; NaN where it has none",
            unit="m",
        ),
    ]
    odom_variance: Annotated[
        NDArray[np.float64],
        Array(
            ("scan", "gathered"),
            "variance of the odometry since its start, as the log gives it: of the position (mean "
            "of x and y), of the heading; NaN where it gives none",
            unit="m², rad²",
        ),
    ]
    grain_m: Annotated[float, "metres per unit of points"]
    skipped: Annotated[Mapping[str, int], "how many scans of the log were left out, by reason"]
    clipped: Annotated[int, "points beyond the 16-bit range that were dropped"]


@dataclass(frozen=True, eq=False)
class Estimates(Artifact, kind="slam", version=1):
    """The poses of one log without any, as estimated from its scans."""

    stamps_ns: Annotated[NDArray[np.int64], Array(("scan",), "when it was taken", unit=SINCE_1970)]
    odom_T_scan: Annotated[
        NDArray[np.float64],
        Array(
            ("scan", "row", "col"),
            "pose by registering scan to scan, before loop closure; starts again after a break",
            unit="m",
        ),
    ]
    world_T_scan: Annotated[
        NDArray[np.float64],
        Array(
            ("scan", "row", "col"),
            "the result; NaN for scans that are joined neither with the longest part nor the map",
            unit="m",
        ),
    ]
    overlap: Annotated[
        NDArray[np.float64],
        Array(
            ("scan",),
            "share of the standing things in this scan that the one before also has, or the other "
            "way round: the larger of the two",
        ),
    ]
    by_log: Annotated[
        NDArray[np.bool_],
        Array(("scan",), "True if the step to this scan is from the log's own odometry"),
    ]
    breaks: Annotated[
        NDArray[np.int64], Array(("break",), "scans that could not be joined with the one before")
    ]
    fixed: Annotated[
        NDArray[np.int64], Array(("fix",), "scans that were located on the training sequence's map")
    ]
    earlier: Annotated[NDArray[np.int64], Array(("loop",), "the earlier scan of a loop")]
    later: Annotated[NDArray[np.int64], Array(("loop",), "the later scan of a loop")]
    earlier_T_later: Annotated[
        NDArray[np.float64],
        Array(("loop", "row", "col"), "the later scan's pose in the earlier one's frame", unit="m"),
    ]
    residual_m: Annotated[
        NDArray[np.float64],
        Array(("loop",), "distance between the loop's pose and the result", unit="m"),
    ]
    residual_deg: Annotated[
        NDArray[np.float64],
        Array(("loop",), "turn between the loop's pose and the result", unit="degree"),
    ]
    used: Annotated[
        NDArray[np.bool_],
        Array(("loop",), "False if the loop contradicts the others and was dropped"),
    ]
    skipped: Annotated[Mapping[str, int], "how many scans have no pose, by reason"]

    @property
    def path_m(self) -> NDArray[np.float64]:
        """Metres (scan,) driven up to each scan; breaks and scans without odometry add none."""
        is_step = np.ones(max(len(self.odom_T_scan) - 1, 0), bool)
        is_step[self.breaks - 1] = False
        return travelled_m(self.odom_T_scan[:, :3, 3], is_step)

    @property
    def posed(self) -> NDArray[np.bool_]:
        """Which scans (scan,) have a pose."""
        return np.asarray(np.isfinite(self.world_T_scan).all(axis=(1, 2)))


@dataclass(frozen=True, eq=False)
class Submaps(Artifact, kind="submaps", version=3):
    """The submaps of one sequence in order of time: which scans each gathers, and its anchor.

    A submap gathers the scans `first` to `scans`, both included. Its anchor is the newest of them.
    """

    first: Annotated[
        NDArray[np.int64],
        Array(("submap",), "the oldest scan that it gathers: a row of the scans artifact"),
    ]
    scans: Annotated[
        NDArray[np.int64],
        Array(("submap",), "the newest scan that it gathers, whose frame is the anchor's"),
    ]
    ground_m: Annotated[
        NDArray[np.float64],
        Array(
            ("submap",),
            "height of the ground in the anchor's frame, which is subtracted from all heights",
            unit="m",
        ),
    ]
    used: Annotated[
        NDArray[np.bool_],
        Array(("scan",), "False if submaps leave the scan out, as the robot hardly moved"),
    ]
    stamps_ns: Annotated[
        NDArray[np.int64], Array(("submap",), "stamp of the anchor", unit=SINCE_1970)
    ]
    world_T_anchor: Annotated[
        NDArray[np.float64],
        Array(("submap", "row", "col"), "true pose of the anchor", unit="m"),
    ]
    layout: Annotated[
        PoseColumn, "the column of the scans artifact whose poses place a submap's scans"
    ]
    left_out: Annotated[Mapping[str, int], "how many anchors made no submap, by reason"]
    appearance: Annotated[
        Mapping[str, float],
        "medians over a few submaps: azimuth_deg, degrees around with points; ground_m and "
        "highest_m, z of the ground and of the top; null if there is none",
    ]


Cases = Annotated[
    Sequence[Mapping[str, Any]],
    "what was done to all queries in each case: change (such as turned), level, shadow, repeat; "
    "arrays have the rows of one case after another",
]


@dataclass(frozen=True, eq=False)
class Views(Artifact):
    """What a method looks at: an image of each submap, in each case (unperturbed, or perturbed).

    The stages views, birdviews and perturbed write such artifacts. The kinds differ in their
    images.
    """

    images: NDArray[Any]
    stamps_ns: Annotated[
        NDArray[np.int64], Array(("submap",), "stamp of the anchor", unit=SINCE_1970)
    ]
    world_T_anchor: Annotated[
        NDArray[np.float64],
        Array(
            ("submap", "row", "col"),
            "true pose of the anchor, with the robot turned as in each case",
            unit="m",
        ),
    ]
    cases: Cases


@dataclass(frozen=True, eq=False)
class ScanContextViews(Views, kind="views", version=2):
    """Scan Contexts: the highest point in each bin of rings and sectors around the robot."""

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
class WallViews(Views, kind="walls", version=1):
    """Walls around the robot, drawn from above, and the space that its sensor saw through."""

    images: Annotated[
        NDArray[np.int8],
        Array(
            ("submap", "x", "y"),
            "2 is a wall, −1 was seen through, 0 is unknown; the robot is in the middle",
            chunk=64,
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
            "points relative to their mean, in units of the cube's half side",
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
    """Bird-views: the octree of the scans so far, seen from above at several headings."""

    images: Annotated[
        NDArray[np.uint8],
        Array(
            ("submap", "heading", "row_px", "col_px"),
            "occupied share times 255, with the robot's front up and its left on the left",
            chunk=16,
            shard=512,
        ),
    ]


VIEW_KINDS = (ScanContextViews, CloudViews, SignatureViews, WallViews, BirdViews)
"""All kinds of views, of which a reader that does not know the method takes any."""


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
            "place of the nearest training anchor: the best that a method can answer",
        ),
    ]
    nearest_m: Annotated[
        NDArray[np.float64],
        Array(("submap",), "distance to the nearest training anchor in the xy plane", unit="m"),
    ]
    nearest_turn_deg: Annotated[
        NDArray[np.float64],
        Array(
            ("submap",),
            "heading relative to the nearest training anchor's, in (−180, 180]",
            unit="degree",
        ),
    ]
    days: Annotated[int, "whole days from the training sequence's date to this one's"]
    cell_m: Annotated[float, "wanted side of a cell in metres"]
    x_m: Annotated[tuple[float, float], "the grid's box along x: lowest, highest"]
    y_m: Annotated[tuple[float, float], "the grid's box along y: lowest, highest"]


@dataclass(frozen=True, eq=False)
class Ranking:
    """A method's answer to queries: k places each, cheapest first, and how new each query looks."""

    places: Annotated[
        NDArray[np.int64], Array(("query", "rank"), "the answered places, cheapest first")
    ]
    costs: Annotated[
        NDArray[np.float32], Array(("query", "rank"), "cost of each place, smaller is better")
    ]
    xy_m: Annotated[
        NDArray[np.float64],
        Array(
            ("query", "rank", "xy"),
            "where each answer lies in the world: at the matched training submap, or the mean of "
            "the place's",
            unit="m",
        ),
    ]
    novelty: Annotated[
        NDArray[np.float32],
        Array(
            ("query", "kind"),
            "how likely the query is unseen, larger is likelier; the first kind is in use",
        ),
    ]
    confidence: Annotated[
        NDArray[np.float32],
        Array(
            ("query",), "probability that the first place is right; NaN where the method gives none"
        ),
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
        """The ranking itself, checked.

        Raises InputError if an array does not have the shape of `n` queries, or a novelty is NaN.
        """
        k = self.places.shape[-1]  # places for each query
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
        other_columns = [column for column in range(len(self.kinds)) if column != first_column]
        order = [first_column, *other_columns]
        return replace(
            self,
            novelty=self.novelty[:, order],
            kinds=tuple(self.kinds[column] for column in order),
        )


@dataclass(frozen=True, eq=False)
class SequenceRanking(Ranking, Artifact):
    """The ranking of one sequence's queries in every case, and when to reject a query as unseen.

    Stage localize writes it as Rankings, the stages poses and paths as Fixes.
    """

    turned_deg: Annotated[
        NDArray[np.float32],
        Array(
            ("query",),
            "angle by which the case turned the robot to the left, in (−180, 180]",
            unit="degree",
        ),
    ]
    cases: Cases
    thresholds: Annotated[
        tuple[float, ...],
        "for each kind of novelty, the value from which a query is rejected as unseen; chosen on "
        "validation blocks of the training sequence",
    ]
    target_precision: Annotated[float, "the precision that the thresholds were chosen for"]

    def ranking(self, rows: slice = slice(None)) -> Ranking:
        """The plain ranking of some of the queries, without what the artifact adds."""
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
class Rankings(SequenceRanking, kind="rankings", version=6):
    """The rankings that a method answers, without poses."""

    validation_precision: Annotated[
        tuple[float, ...],
        "the precision that each threshold reaches on the validation blocks: target_precision or "
        "less, null if it accepts nothing",
    ]


REJECT_ALL = -1.0
"""The novelty from which poses are rejected if no precision can be kept: no novelty is below 0."""


@dataclass(frozen=True, eq=False)
class Fixes(SequenceRanking, kind="fixes", version=6):
    """Rankings of queries that were registered to poses; the first novelty is of these poses."""

    world_T_query: Annotated[
        NDArray[np.float64],
        Array(
            ("query", "row", "col"),
            "the query's pose; NaN where it has too few points to register",
            unit="m",
        ),
    ]
    covariance: Annotated[
        NDArray[np.float64],
        Array(
            ("query", "turn_step_row", "turn_step_col"),
            "covariance of the pose's error in six numbers: a turn about x, y and z in radians, "
            "then a step along x, y and z in metres; calibrated on validation blocks, of level "
            "sweeps not; NaN along a path",
        ),
    ]
    overlap: Annotated[
        NDArray[np.float32],
        Array(
            ("query",),
            "share of the query's voxels that the map also has; along a path, that of the query's "
            "own fix",
        ),
    ]
    target_precisions: Annotated[
        tuple[float, ...], "shares of right poses among the accepted ones that a user may ask for"
    ]
    pose_thresholds: Annotated[
        tuple[float, ...],
        "for each target precision, the novelty of the first kind from which a pose is rejected; "
        "chosen on validation blocks of the training sequence",
    ]
    place_thresholds: Annotated[
        tuple[float, ...],
        "the same of the novelty `place`: the claim is that the query is within 15 m of its pose",
    ]
    several_thresholds: Annotated[
        tuple[float, ...],
        "the same of the novelty `several`: the claim is that one of its first poses is right",
    ]
    validation_blocks: Annotated[
        int,
        "how many validation blocks there are; each is queried unperturbed, with simulated "
        "ageing, and without its surroundings",
    ]
    right_within: Annotated[
        tuple[float, float],
        "metres and degrees within which a pose is right: 2 and 5, or 1 and 10 for level sweeps",
    ]

    def kept_precision(self, wanted: float = JUDGED_PRECISION) -> float | None:
        """The precision that accepted poses keep if this one is wanted: see core.precisions.

        None if there is no threshold for any.
        """
        by_precision = zip(self.target_precisions, self.pose_thresholds, strict=True)
        return kept_precision((p for p, threshold in by_precision if threshold > 0), wanted)

    def reject_from(self, wanted: float = JUDGED_PRECISION, claim: str = "fix") -> float:
        """The novelty from which a claim is rejected, so that accepted claims keep a precision.

        The precision is the one that is kept for the `wanted` one; if there is none, nothing is
        accepted. The claim is that the pose is right (`fix`), that the query is near it (`place`),
        or that one of the query's first poses is right (`several`).
        """
        kept = self.kept_precision(wanted)
        if kept is None:
            return REJECT_ALL
        thresholds = {
            "fix": self.pose_thresholds,
            "place": self.place_thresholds,
            "several": self.several_thresholds,
        }
        return thresholds[claim][self.target_precisions.index(kept)]


@dataclass(frozen=True, eq=False)
class Maps(Artifact, kind="maps", version=1):
    """The training day's submaps, thinned, to register queries against."""

    points: Annotated[
        NDArray[np.int16],
        Array(
            ("point", "xyz"),
            "one point a voxel, in the anchor's frame, z up from the ground, in units of grain_m",
            unit="grain_m",
            chunk=32_768,
        ),
    ]
    offsets: Annotated[
        NDArray[np.int64],
        Array(("submap+1",), "the points of submap i are points[offsets[i]:offsets[i + 1]]"),
    ]
    world_T_anchor: Annotated[
        NDArray[np.float64],
        Array(("submap", "row", "col"), "true pose of each training submap's anchor", unit="m"),
    ]
    grain_m: Annotated[float, "metres per unit of points"]
    voxel_m: Annotated[float, "side of a voxel"]
    range_m: Annotated[float, "points farther from the anchor are left out"]
    single: Annotated[bool, "True if each submap is one scan, seen from one place"]


@dataclass(frozen=True, eq=False)
class TiledMaps(Artifact, kind="tiled_map", version=1):
    """A 3-D map that a study learns instead of a drive, to register queries with its cut-outs."""

    points: Annotated[
        NDArray[np.int16],
        Array(
            ("point", "xyz"),
            "one point a voxel, from the corner of its tile, in units of grain_m",
            unit="grain_m",
            chunk=32_768,
        ),
    ]
    offsets: Annotated[
        NDArray[np.int64],
        Array(("tile+1",), "the points of tile i are points[offsets[i]:offsets[i + 1]]"),
    ]
    tile_corner_m: Annotated[
        NDArray[np.float64],
        Array(
            ("tile", "xyz"),
            "lower corner of each tile along x and y, and a height near its points",
            unit="m",
        ),
    ]
    world_T_anchor: Annotated[
        NDArray[np.float64],
        Array(
            ("anchor", "row", "col"),
            "pose on the ground of each anchor, around which the map is cut out",
            unit="m",
        ),
    ]
    walls: Annotated[
        NDArray[np.uint8],
        Array(("x", "y"), "points of walls in each cell, from above; 255 if there are more"),
    ]
    walls_corner_m: Annotated[
        NDArray[np.float64], Array(("xy",), "lower corner of the first cell of walls", unit="m")
    ]
    grain_m: Annotated[float, "metres per unit of points"]
    voxel_m: Annotated[float, "side of a voxel"]
    range_m: Annotated[float, "points farther from the anchor are left out of its cut-out"]
    cell_m: Annotated[float, "side of a cell of walls"]


@dataclass(frozen=True, eq=False)
class Verdicts(Artifact, kind="verdict", version=3):
    """When to accept a pose, as learned from validation blocks of the training day."""

    pose_weights: Annotated[
        NDArray[np.float64],
        Array(("feature",), "weight of each feature in the probability that a pose is right"),
    ]
    place_weights: Annotated[
        NDArray[np.float64],
        Array(("feature",), "weight of each feature in the probability that a pose is near"),
    ]
    expected_xy_m: Annotated[
        NDArray[np.float64],
        Array(("right_fix", "xy"), "where a right fix of a validation query is", unit="m"),
    ]
    expected_features: Annotated[
        NDArray[np.float64],
        Array(
            ("right_fix", "scan_feature"),
            "features of a right fix, with which those of a query are compared",
        ),
    ]
    covariance_typical: Annotated[
        NDArray[np.float64],
        Array(
            ("covariance_group",),
            "typical deviation of a registration, before it is calibrated: tilt and turn in "
            "radians, step along x or y and step along z in metres; none for level sweeps",
        ),
    ]
    covariance_scales: Annotated[
        NDArray[np.float64],
        Array(("covariance_group",), "factor on these deviations"),
    ]
    covariance_power: Annotated[
        float, "power of a registration's covariance, in units of the typical deviations"
    ]
    pose_offset: Annotated[float, "log odds that a pose is right where all features are 0"]
    place_offset: Annotated[float, "log odds that a pose is near where all features are 0"]
    target_precisions: Annotated[
        tuple[float, ...], "shares of right poses among the accepted ones that a user may ask for"
    ]
    pose_thresholds: Annotated[
        tuple[float, ...],
        "for each target precision, the error probability from which a pose is rejected",
    ]
    place_thresholds: Annotated[
        tuple[float, ...], "the same of the claim that a query is near its pose"
    ]
    several_thresholds: Annotated[
        tuple[float, ...], "the same of the claim that one of a query's first poses is right"
    ]
    validation_blocks: Annotated[int, "how many validation blocks there are"]
    unseen_share: Annotated[float, "share of queries that are expected where training never went"]
    fix_count: Annotated[int, "how many fixes of validation queries it was learned from"]
    least_overlap: Annotated[float, "overlap from which a rough registration is refined"]
    basis: Annotated[
        str,
        "what it was learned with, as JSON: a digest of the model or of the sweeps' poses, and the "
        "settings; a site is packed from it only if its own are the same",
    ]


@dataclass(frozen=True, eq=False)
class Lifelong(Artifact, kind="lifelong", version=4):
    """What a localiser answers to the queries of all test days after each step of learning."""

    right: Annotated[
        NDArray[np.bool_],
        Array(("step", "query"), "True if the first answer is the query's cell", chunk=8, shard=8),
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
        Array(("query",), "the step from which the query's cell was covered; −1 for never"),
    ]
    day: Annotated[NDArray[np.int64], Array(("query",), "index of the queried day")]
    xy_m: Annotated[
        NDArray[np.float64], Array(("query", "xy"), "where the query was taken", unit="m")
    ]
    place_xy_m: Annotated[
        NDArray[np.float64],
        Array(("place", "xy"), "centre of each cell covered by the last step", unit="m"),
    ]
    newest_ns: Annotated[
        NDArray[np.int64],
        Array(
            ("place",),
            "stamp of the cell's newest view that was learned at a reference pose or "
            "pseudo-labelled",
            unit=SINCE_1970,
        ),
    ]
    order: Annotated[str, "days, streets or self_training: what is learned in each step"]
    strategy: Annotated[str, "how a model learns it: a file of conf/strategy"]
    steps: Annotated[tuple[str, ...], "name of each step"]
    queried: Annotated[tuple[str, ...], "name of each queried day"]
    learned_ns: Annotated[tuple[int, ...], "stamp of the newest view after each step"]
    queried_ns: Annotated[tuple[int, ...], "first stamp of each queried day"]
    correct_m: Annotated[float, "an answer is right by distance if it is at most so far away"]
    places: Annotated[tuple[int, ...], "how many cells were covered by each step"]
    bytes: Annotated[  # the name in the artifact; nothing here calls the built-in
        tuple[int, ...], "size of the model after each step"
    ]
    counts: Annotated[
        Sequence[Mapping[str, int]],
        "counts of each update: scans that were queried, pseudo-labelled, and pseudo-labelled at a "
        "wrong pose; submaps that changed",
    ]
