"""The data dictionary: every artifact, every array in it, its dimensions, type and unit.

Dimensions of one name have one length within an artifact; `n+1` marks an array of offsets into the ragged one.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Column:
    """One array of an artifact; its first dimension is the row dimension."""

    dtype: str
    dims: tuple[str, ...]
    doc: str
    chunk: int = 65_536
    """Rows read and compressed together."""
    shard: int = 4_194_304
    """Rows in one file; a multiple of `chunk`."""


@dataclass(frozen=True)
class Schema:
    """One kind of artifact: a zarr group with these arrays and these attributes besides `kind` and `version`."""

    kind: str
    version: int
    columns: Mapping[str, Column]
    attrs: Mapping[str, str] = field(default_factory=dict)


SCANS = Schema(
    "scans",
    1,
    {
        "points": Column(
            "i2", ("point", "xyz"), "in units of grain_m, vehicle frame (x forward, y left, z up, ground at 0)", 32_768
        ),
        "offsets": Column("i8", ("scan+1",), "scan i is points[offsets[i]:offsets[i + 1]]"),
        "stamps_ns": Column("i8", ("scan",), "nanoseconds since 1970"),
        "world_T_scan": Column("f8", ("scan", "row", "col"), "ground truth at the stamp"),
        "odom_T_scan": Column("f8", ("scan", "row", "col"), "the log's own odometry at the stamp; NaN where it has none"),
    },
    {
        "grain_m": "metres per unit of points",
        "skipped": "scans of the log that are not here: reason to count",
        "clipped": "points beyond the 16-bit range that were dropped",
    },
)
SUBMAPS = Schema(
    "submaps",
    1,
    {
        "scans": Column("i8", ("submap",), "the scan that makes it: a row of the scans artifact, whose frame is the anchor's"),
        "stamps_ns": Column("i8", ("submap",), "of the anchor, nanoseconds since 1970"),
        "world_T_anchor": Column("f8", ("submap", "row", "col"), "ground truth of the anchor"),
    },
)
VIEWS = Schema(
    "views",
    1,
    {
        "images": Column("f4", ("submap", "ring", "sector"), "Scan Context: highest z in metres, 0 where empty", 32, 2_048),
        "stamps_ns": Column("i8", ("submap",), "of the anchor, nanoseconds since 1970"),
        "world_T_anchor": Column("f8", ("submap", "row", "col"), "ground truth of the anchor"),
    },
)
LABELS = Schema(
    "labels",
    1,
    {
        "places": Column("i8", ("submap",), "place id of the anchor's cell; −1 where training never went"),
        "cells": Column("i8", ("place",), "grid cell of each place, x-major"),
        "oracle": Column("i8", ("submap",), "place of the geometrically nearest training anchor"),
        "nearest_m": Column("f8", ("submap",), "distance to that anchor in the xy plane"),
        "nearest_turn_deg": Column("f8", ("submap",), "heading against that anchor's, in (−180, 180]"),
    },
    {
        "days": "whole days from the training sequence's date to this one's",
        "cell_m": "wanted side of a cell in metres",
        "x_m": "the grid's box along x: lowest, highest",
        "y_m": "the grid's box along y: lowest, highest",
    },
)
RANKINGS = Schema(
    "rankings",
    1,
    {
        "places": Column("i8", ("query", "rank"), "places, cheapest first"),
        "costs": Column("f4", ("query", "rank"), "cost of each, smaller is better"),
        "xy_m": Column("f8", ("query", "rank", "xy"), "where each answer lies in the world"),
        "novelty": Column("f4", ("query",), "larger: more likely unseen"),
        "heading_deg": Column("f4", ("query",), "how the query is turned; NaN where the method cannot tell"),
    },
    {"threshold": "reject as unseen from this novelty on; chosen on held-out blocks of the training sequence"},
)
EVALUATIONS = Schema(
    "evaluations",
    1,
    {
        "thresholds": Column("f8", ("threshold",), "novelties from which a query is rejected"),
        "hits": Column("i8", ("top_n", "threshold"), "accepted, and the true place among the first n"),
        "misses": Column("i8", ("top_n", "threshold"), "rejected although seen"),
        "false_alarms": Column("i8", ("top_n", "threshold"), "accepted, and wrong or unseen"),
        "correct_rejections": Column("i8", ("top_n", "threshold"), "rejected and unseen"),
        "precision": Column("f8", ("top_n", "threshold"), "hits / (hits + false alarms)"),
        "recall": Column("f8", ("top_n", "threshold"), "hits / (hits + misses)"),
        "auc": Column("f8", ("top_n",), "area under precision over recall"),
        "true_rank": Column("i8", ("query",), "0-based rank of the true place; −1 if unseen or not among the ranked"),
        "seen": Column("?", ("query",), "its cell is a place of the training sequence"),
        "novelty": Column("f4", ("query",), "as ranked"),
        "outcome": Column("i1", ("query",), "at the model's threshold: 0 hit, 1 miss, 2 false alarm, 3 correct rejection"),
        "xy_m": Column("f8", ("query", "xy"), "where the query was taken"),
        "error_m": Column("f8", ("query",), "distance from there to the first answer"),
        "turn_deg": Column("f8", ("query",), "heading against the nearest training anchor's"),
        "oracle_right": Column("?", ("query",), "the nearest training anchor's place is the true one"),
    },
    {
        "days": "whole days since the training sequence",
        "threshold": "novelty from which the model rejects",
        "sequence": "the test sequence",
        "train": "the training sequence",
    },
)

ALL = (SCANS, SUBMAPS, VIEWS, LABELS, RANKINGS, EVALUATIONS)
