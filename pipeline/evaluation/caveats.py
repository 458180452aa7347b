"""Caveats: reasons why a score says little or nothing, as rows of the table of results.

In: a model's answers to the queries of one test sequence, or the submaps of that sequence. Out: for
each caveat that applies, its name and the value that gives rise to it. One caveat makes a score
degenerate: that a single answer to every query would be right for half of the seen ones.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core.schemas import Submaps
from pipeline.evaluation.protocols import Distance
from pipeline.matching.rejection import ACCEPT_NOTHING

BLIND = "blind_recall_at_1"
"""The row that every score has: the recall@1 of a single answer to every query."""
DEGENERATE = "degenerate"
"""The row of a score that is degenerate: it is 1 where BLIND is HALF or more, or undefined."""
UNCALIBRATED = "caveat_uncalibrated"
NO_REFERENCE_POSES = "caveat_no_reference_poses"

HALF = 0.5
FEW_SEEN = 30
FEW_BLOCKS = 5
"""A sign test of five blocks cannot reach p = .05: with all of one sign it gives 2 / 2⁵."""
ROUND_DEG = 300.0
GROUND_M = 0.5
LOW_M = 1.0
"""The bounds at which caveats begin; MEANINGS says which quantity each bounds."""

MEANINGS = {
    "caveat_one_answer": f"share of the queries that get the commonest answer, if {HALF} or more",
    "caveat_few_seen": f"number of seen queries, if {FEW_SEEN} or fewer",
    "caveat_few_blocks": (
        f"number of blocks of the path with seen queries, if {FEW_BLOCKS} or fewer"
    ),
    "caveat_all_rejected": "1 if every query is rejected",
    "caveat_none_rejected": "1 if no query is rejected",
    "caveat_no_threshold": "1 if no threshold was found on validation blocks; all is rejected",
    "caveat_less_precise": "validation precision, if below the target precision",
    "caveat_not_all_round": f"degrees of azimuth in which submaps have points, if < {ROUND_DEG}",
    "caveat_ground": f"height of the submaps' ground, if more than {GROUND_M} m from z = 0",
    "caveat_low": f"height of the submaps' highest points, if below {LOW_M} m",
    "caveat_windows": f"share of the drive that has no submap, since its window of sweeps was not "
    f"yet whole, if {HALF} or more",
    UNCALIBRATED: "1 if poses are accepted by the usual probabilities, without validation blocks",
    NO_REFERENCE_POSES: "1 if the true poses were estimated from the same scans that are judged",
}
"""Name of each caveat to the value in its row. A caveat that does not apply has no row."""
CAVEATS = tuple(MEANINGS)


def blind(
    places: NDArray[np.int64],
    nearest_m: NDArray[np.float64],
    xy_m: NDArray[np.float64],
    distance: Distance,
) -> dict[str, float]:
    """The largest share of seen queries for which a single answer is right, by protocol.

    By cells, the best answer is the commonest of the true `places` (q,), where −1 is unseen. By
    distance, the answers tried are the positions `xy_m` (q, 2) of the seen queries; `nearest_m`
    (q,) is each query's distance to training. NaN where no query is seen.
    """
    shares = {"cells": np.nan, "distance": np.nan}
    seen_places = places[places >= 0]
    if len(seen_places):
        shares["cells"] = float(np.bincount(seen_places).max() / len(seen_places))
    seen_xy_m = xy_m[nearest_m < distance.seen_m]
    if len(seen_xy_m):
        neighbours = KDTree(seen_xy_m).query_ball_point(
            seen_xy_m, distance.correct_m, return_length=True
        )
        shares["distance"] = float(neighbours.max() / len(seen_xy_m))
    return shares


def caveats(
    blind_recall: float,
    answers: NDArray[np.int64],
    novelty: NDArray[np.floating],
    reject_from: float,
    validation_precision: float,
    target_precision: float,
    seen_count: int,
    block_count: int,
) -> dict[str, float]:
    """The caveats about one score that apply, name to value; BLIND is always among them.

    `answers` and `novelty` (q,) are the model's first answers and how new each query looks. A query
    is rejected if its novelty is `reject_from` or more. That threshold was chosen for
    `target_precision`, and reaches `validation_precision` on validation blocks. `seen_count` is the
    number of seen queries, `block_count` the number of blocks of the path that hold them.
    `blind_recall` is what `blind` returns for the protocol of the score.
    """
    values = {BLIND: blind_recall}
    _, answer_counts = np.unique(answers, return_counts=True)
    commonest_share = answer_counts.max(initial=0) / max(len(answers), 1)
    if commonest_share >= HALF:
        values["caveat_one_answer"] = float(commonest_share)
    if seen_count <= FEW_SEEN:
        values["caveat_few_seen"] = float(seen_count)
    if block_count <= FEW_BLOCKS:
        values["caveat_few_blocks"] = float(block_count)
    is_rejected = novelty.astype(np.float64) >= reject_from
    has_threshold = reject_from > ACCEPT_NOTHING
    if has_threshold and is_rejected.all():
        values["caveat_all_rejected"] = 1.0
    if not is_rejected.any():
        values["caveat_none_rejected"] = 1.0
    if not has_threshold:
        values["caveat_no_threshold"] = 1.0
    if validation_precision < target_precision:
        values["caveat_less_precise"] = float(validation_precision)
    if not blind_recall < HALF:  # so NaN is degenerate too
        values[DEGENERATE] = 1.0
    return values


def unsuited(submaps: Submaps) -> dict[str, float]:
    """The reasons why the submaps of a sequence do not suit the views, name to value.

    A property that was not measured is NaN, and gives rise to no caveat.
    """
    azimuth_deg = float(submaps.appearance["azimuth_deg"])
    ground_m = float(submaps.appearance["ground_m"])
    highest_m = float(submaps.appearance["highest_m"])
    anchor_count = len(submaps.scans) + sum(submaps.left_out.values())
    no_window_share = submaps.left_out.get("window not yet whole", 0) / anchor_count
    values: dict[str, float] = {}
    if azimuth_deg < ROUND_DEG:
        values["caveat_not_all_round"] = azimuth_deg
    if abs(ground_m) > GROUND_M:
        values["caveat_ground"] = ground_m
    if highest_m < LOW_M:
        values["caveat_low"] = highest_m
    if no_window_share >= HALF:
        values["caveat_windows"] = no_window_share
    return values
