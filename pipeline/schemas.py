"""The data dictionary: every artifact, every array in it, its dimensions, type and unit.

Dimensions of one name have one length within an artifact; `n+1` marks an array of offsets into the
ragged one.
"""

from pipeline.store import Column, Schema

SCANS = Schema(
    "scans",
    1,
    {
        "points": Column(
            "i2",
            ("point", "xyz"),
            "in units of grain_m, vehicle frame (x forward, y left, z up)",
            32_768,
        ),
        "offsets": Column(
            "i8",
            ("scan+1",),
            "scan (or sweep of a 2-D LiDAR) i is points[offsets[i]:offsets[i + 1]]",
        ),
        "stamps_ns": Column("i8", ("scan",), "nanoseconds since 1970"),
        "world_T_scan": Column(
            "f8",
            ("scan", "row", "col"),
            "ground truth at the stamp; NaN where odometry alone is known",
        ),
        "odom_T_scan": Column(
            "f8",
            ("scan", "row", "col"),
            "the log's own odometry at the stamp; NaN where it has none",
        ),
    },
    {
        "grain_m": "metres per unit of points",
        "skipped": "scans of the log that are not here: reason to count",
        "clipped": "points beyond the 16-bit range that were dropped",
    },
)
SUBMAPS = Schema(
    "submaps",
    3,
    {
        "first": Column(
            "i8", ("submap",), "the oldest scan that it gathers: a row of the scans artifact"
        ),
        "scans": Column("i8", ("submap",), "the newest, whose frame is the anchor's"),
        "ground_m": Column(
            "f8", ("submap",), "height of the ground in that frame, taken off all heights"
        ),
        "used": Column("?", ("scan",), "scans that go into the submaps around them"),
        "stamps_ns": Column("i8", ("submap",), "of the anchor, nanoseconds since 1970"),
        "world_T_anchor": Column("f8", ("submap", "row", "col"), "ground truth of the anchor"),
    },
    {
        "layout": "the column of the scans artifact whose poses lay a submap's scans out",
        "left_out": "anchors that make no submap: reason to count",
        "appearance": (
            "medians over a few submaps: azimuth_deg with points, z of the ground, ground_m, and "
            "of the top, highest_m"
        ),
    },
)


CASES = (
    "what was done to the queries, such as turned: change, level, shadow, repeat; a row a submap "
    "in each, case after case"
)


def _view(kind: str, column: Column) -> Schema:
    """One view of each submap: what a method looks at."""
    anchor = {
        "stamps_ns": Column("i8", ("submap",), "of the anchor, nanoseconds since 1970"),
        "world_T_anchor": Column(
            "f8",
            ("submap", "row", "col"),
            "true pose of the anchor, turned as the robot is in each case",
        ),
    }
    return Schema(kind, 2, {"images": column, **anchor}, {"cases": CASES})


VIEWS = _view(
    "views",
    Column(
        "f4",
        ("submap", "ring", "sector"),
        "Scan Context: highest z in metres, 0 where empty",
        32,
        2_048,
    ),
)
CLOUDS = _view(
    "clouds",
    Column(
        "f2",
        ("submap", "point", "xyz"),
        "about their mean, in units of the cube's half side",
        16,
        512,
    ),
)
SIGNATURES = _view(
    "signatures",
    Column("f4", ("submap", "number"), "a descriptor that needs no training", 512, 4_096),
)
BIRDVIEWS = _view(
    "birdviews",
    Column(
        "u1",
        ("submap", "heading", "row_px", "col_px"),
        "occupied share of 255, front up, left left",
        16,
        512,
    ),
)
LOOKED_AT = (VIEWS, CLOUDS, SIGNATURES, BIRDVIEWS)
"""Artifacts of the stages views, birdviews and altered."""
LABELS = Schema(
    "labels",
    1,
    {
        "places": Column(
            "i8", ("submap",), "place id of the anchor's cell; −1 where training never went"
        ),
        "cells": Column("i8", ("place",), "grid cell of each place, x-major"),
        "oracle": Column("i8", ("submap",), "place of the geometrically nearest training anchor"),
        "nearest_m": Column("f8", ("submap",), "distance to that anchor in the xy plane"),
        "nearest_turn_deg": Column(
            "f8", ("submap",), "heading against that anchor's, in (−180, 180]"
        ),
    },
    {
        "days": "whole days from the training sequence's date to this one's",
        "cell_m": "wanted side of a cell in metres",
        "x_m": "the grid's box along x: lowest, highest",
        "y_m": "the grid's box along y: lowest, highest",
    },
)
_ANSWERED = {
    "cases": CASES,
    "kinds": "name of each kind of novelty",
    "thresholds": (
        "reject as unseen from this novelty on, for each kind; chosen on held-out blocks of the "
        "training sequence"
    ),
    "wanted_precision": "that they were chosen for",
}
RANKINGS = Schema(
    "rankings",
    5,
    {
        "places": Column("i8", ("query", "rank"), "places, cheapest first"),
        "costs": Column("f4", ("query", "rank"), "cost of each, smaller is better"),
        "xy_m": Column("f8", ("query", "rank", "xy"), "where each answer lies in the world"),
        "novelty": Column(
            "f4", ("query", "kind"), "larger: more likely unseen; the first kind is the one in use"
        ),
        "confidence": Column(
            "f4",
            ("query",),
            "chance that the first place is right; NaN where the method gives none",
        ),
        "heading_deg": Column(
            "f4",
            ("query", "rank"),
            "the query's yaw in the world, in (−180, 180], if that answer is right",
        ),
        "turned_deg": Column(
            "f4", ("query",), "by how much the case turned the robot to the left, in (−180, 180]"
        ),
    },
    {
        **_ANSWERED,
        "kept_precision": (
            "that each threshold keeps on those blocks, wanted or less; null of one that accepts "
            "nothing"
        ),
    },
)
FIXES = Schema(
    "fixes",
    4,
    {
        **RANKINGS.columns,
        "world_T_query": Column(
            "f8",
            ("query", "row", "col"),
            "the query's pose; NaN where it has too few points to tell",
        ),
        "covariance": Column(
            "f8",
            ("query", "turn_step", "turn_step"),
            "of a turn in radians and a step in metres; NaN along a path",
        ),
        "overlap": Column(
            "f4",
            ("query",),
            "share of the query's voxels that the map has; that of its own fix along a path",
        ),
    },
    {
        **_ANSWERED,
        "promises": "precisions that a user may want",
        "promised": (
            "reject from this novelty in use on to keep each of them, by held-out blocks of the "
            "training sequence"
        ),
        "promised_place": "the same of the novelty `place`: the query is within 15 m of its pose",
        "promised_several": "the same of the novelty `several`: one of its first poses is right",
        "held_out": (
            "how many of those blocks there are, each asked as driven, aged, and without its "
            "surroundings"
        ),
    },
)
ANSWERS = (RANKINGS, FIXES)  # of the stages localize and poses
MAPS = Schema(
    "maps",
    1,
    {
        "points": Column(
            "i2",
            ("point", "xyz"),
            "one a voxel, in grains, anchor's frame, z up from the ground",
            32_768,
        ),
        "offsets": Column("i8", ("submap+1",), "submap i is points[offsets[i]:offsets[i + 1]]"),
        "world_T_anchor": Column(
            "f8", ("submap", "row", "col"), "true pose of each training submap's anchor"
        ),
    },
    {
        "grain_m": "metres per unit of points",
        "voxel_m": "side of a voxel",
        "range_m": "points farther from the anchor are left out",
        "single": "each submap is one scan, seen from one place",
    },
)


def _judged(dtype: str, dims: tuple[str, ...], doc: str) -> Column:
    """A column of an evaluation: a row a case."""
    return Column(dtype, ("case", *dims), doc, chunk=1, shard=64)


EVALUATIONS = Schema(
    "evaluations",
    9,
    {
        "thresholds": _judged("f8", ("threshold",), "novelties from which a query is rejected"),
        "hits": _judged(
            "i8", ("protocol", "top_n", "threshold"), "accepted, and a true place among the first n"
        ),
        "misses": _judged("i8", ("protocol", "top_n", "threshold"), "rejected although seen"),
        "false_alarms": _judged(
            "i8", ("protocol", "top_n", "threshold"), "accepted, and wrong or unseen"
        ),
        "correct_rejections": _judged(
            "i8", ("protocol", "top_n", "threshold"), "rejected and unseen"
        ),
        "precision": _judged(
            "f8", ("protocol", "top_n", "threshold"), "hits / (hits + false alarms)"
        ),
        "recall": _judged(
            "f8",
            ("protocol", "top_n", "threshold"),
            "cells: hits / (hits + misses); distance: hits / seen",
        ),
        "auc": _judged(
            "f8", ("protocol", "top_n"), "area under precision over recall through these thresholds"
        ),
        "auc_exact": _judged(
            "f8", ("protocol", "top_n"), "the same through every distinct novelty"
        ),
        "recall_at": _judged(
            "f8",
            ("protocol", "top_n"),
            "share of the seen with a true place among the first n; NaN of none",
        ),
        "true_rank": _judged(
            "i8",
            ("protocol", "query"),
            "0-based rank of the first true place; −1 if unseen or not ranked",
        ),
        "seen": _judged("?", ("protocol", "query"), "training went there"),
        "unseen": _judged(
            "?",
            ("protocol", "query"),
            "training never went there; a query that is neither is not judged",
        ),
        "outcome": _judged(
            "i1",
            ("protocol", "query"),
            "0 hit, 1 miss, 2 false alarm, 3 correct rejection, 4 not judged",
        ),
        "oracle_right": _judged(
            "?", ("protocol", "query"), "answering the nearest training anchor would be right"
        ),
        "numbers": _judged(
            "f8",
            ("protocol", "number", "bound3"),
            "value, lowest and highest of its 95 % interval; NaN of none",
        ),
        "rejection": _judged(
            "f8",
            ("protocol", "kind", "measure", "bound3"),
            "value, lowest, highest: how each novelty rejects",
        ),
        "calibration": _judged(
            "f8", ("confidence2",), "expected calibration error of 1 − cost and of the confidence"
        ),
        "novelty": _judged("f4", ("query", "kind"), "as ranked; the first kind is the one in use"),
        "confidence": _judged("f4", ("query",), "as ranked"),
        "answer": _judged("i8", ("query",), "the place ranked first"),
        "cost": _judged("f4", ("query",), "of that place"),
        "xy_m": _judged("f8", ("query", "xy"), "where the query was taken"),
        "answer_xy_m": _judged("f8", ("query", "xy"), "where the first answer lies"),
        "error_m": _judged("f8", ("query",), "distance from the one to the other"),
        "heading_error_deg": _judged(
            "f8", ("query",), "heading of the answer against the true one, 0 to 180; NaN of none"
        ),
        "nearest_m": _judged("f8", ("query",), "distance to the nearest training anchor"),
        "turn_deg": _judged("f8", ("query",), "heading against the nearest training anchor's"),
        "pose_error_m": _judged(
            "f8", ("query",), "distance of the pose from the true one; NaN of none"
        ),
        "pose_error_deg": _judged(
            "f8", ("query",), "turn of the pose against the true one; NaN of none"
        ),
    },
    {
        "cases": (
            "what was done to the queries: change, level, shadow and repeat of each; the first is "
            "as driven"
        ),
        "days": "whole days since the training sequence",
        "sequence": "the test sequence",
        "train": "the training sequence",
        "protocols": "name of each protocol",
        "numbers": "name of each number",
        "measures": "name of each measure of rejection",
        "kinds": "name of each kind of novelty",
        "reject_from": "novelty from which the model rejects, for each kind",
        "wanted_precision": "that it was chosen for",
        "kept_precision": (
            "that it keeps on held-out blocks of training, for each kind; null where that is not "
            "known"
        ),
        "promised": (
            "novelty from which to reject to keep .99 of the poses; null of a method that gives "
            "none"
        ),
        "blind": (
            "by protocol, recall@1 of one and the same answer to every query; null of none seen"
        ),
        "unsuited": "doubts about its submaps, which do not suit the views",
        "distance": "the distances of the protocol by distance, in metres",
        "bootstrap": "how the intervals were computed",
    },
)

VIEWPOINTS = Schema(
    "viewpoints",
    2,
    {
        "headings_deg": Column(
            "f8",
            ("heading",),
            "how far the queries are turned against the sequence's own heading",
            8,
            8,
        ),
        "values": Column(
            "f8", ("heading", "number"), "each number at each heading; NaN of none", 8, 8
        ),
        "row": Column(
            "i8",
            ("heading", "query"),
            "of the sequence itself, that the query was matched with",
            8,
            8,
        ),
        "answer_xy_m": Column(
            "f8", ("heading", "query", "xy"), "where the match lies; NaN of none", 8, 8
        ),
        "error_m": Column(
            "f8", ("heading", "query"), "distance from the query to it; NaN of none", 8, 8
        ),
        "score": Column(
            "f4",
            ("heading", "query"),
            "how sure the match is, larger is surer: the novelty in use, negated",
            8,
            8,
        ),
        "correct": Column("?", ("heading", "query"), "the match lies within correct_m", 8, 8),
        "valid": Column(
            "?",
            ("query",),
            "far enough from the sequence's ends for a whole window of rows around it",
        ),
        "xy_m": Column("f8", ("query", "xy"), "where the query was taken"),
        "pictures": Column(
            "u1",
            ("picture", "row_px", "col_px"),
            "views of the middle place at the reference's headings",
            8,
            64,
        ),
        "reconstructed": Column(
            "u1", ("reconstruction", "row_px", "col_px"), "what a network makes of them", 8, 64
        ),
    },
    {
        "numbers": "name of each number",
        "correct_m": "largest distance of a correct match, in metres",
        "length": "steps in a window of rows",
        "novelty": "name of the novelty in use",
        "bytes_per_place": "by how much the model grows with a reference place",
    },
)

ALL = (SCANS, SUBMAPS, *LOOKED_AT, LABELS, MAPS, RANKINGS, FIXES, EVALUATIONS, VIEWPOINTS)
