"""Doubts: conditions under which a score says little or nothing; rows of the table of results."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline.core.schemas import Submaps
from pipeline.evaluation.protocols import Distance
from pipeline.matching.rejection import ACCEPT_NOTHING

BLIND = "blind_recall_at_1"
"""What one and the same answer to every query would reach: half of it all, and the score is
void."""
VOID = "void"
HALF = 0.5
FEW = 30
FEW_BLOCKS = 5
UNSUITED = ("doubt_not_all_round", "doubt_ground", "doubt_low", "doubt_windows")
OF_SCORES = (
    "one_answer",
    "few_seen",
    "few_blocks",
    "all_rejected",
    "none_rejected",
    "no_threshold",
    "less_kept",
)
NO_SURVEY = "doubt_no_survey"
DOUBTS = (*(f"doubt_{name}" for name in OF_SCORES), *UNSUITED, NO_SURVEY)
"""Rows that are there where they apply: the share of queries that get the commonest answer, if half
or more; how many queries are seen, if FEW or fewer, and in how many blocks of the path, if
FEW_BLOCKS or fewer; 1 where all are rejected, none is, or no threshold kept any precision on
held-out blocks; the precision that it kept there, if less than wanted. Of the submaps: degrees of
azimuth with points, under ROUND_DEG; z of the ground, farther than GROUND_M from 0; z of the
highest points, under LOW_M; the share of the drive without a whole window, if half or more. Last, 1
where the poses that judge were estimated from the scans themselves."""
ROUND_DEG = 300.0
GROUND_M = 0.5
LOW_M = 1.0


def blind(
    places: NDArray[np.int64],
    nearest_m: NDArray[np.float64],
    xy_m: NDArray[np.float64],
    distance: Distance,
) -> dict[str, float]:
    """By protocol, the share of seen queries for which one and the same answer would be right.

    By cells that answer is the commonest of the true `places` (q,), −1 unseen; by distance the
    position of a seen query, given where all were taken, `xy_m` (q, 2), and how far they are from
    training, `nearest_m` (q,). NaN where no query is seen.
    """
    seen_places = places[places >= 0]
    seen_xy_m = xy_m[nearest_m < distance.seen_m]
    shares = {"cells": np.nan, "distance": np.nan}
    if len(seen_places):
        shares["cells"] = float(np.bincount(seen_places).max() / len(seen_places))
    if len(seen_xy_m):
        neighbours = KDTree(seen_xy_m).query_ball_point(
            seen_xy_m, distance.correct_m, return_length=True
        )
        shares["distance"] = float(neighbours.max() / len(seen_xy_m))
    return shares


def doubts(
    blind: float,
    answers: NDArray[np.int64],
    novelty: NDArray[np.floating],
    reject_from: float,
    kept_precision: float,
    wanted_precision: float,
    seen: int,
    blocks: int,
) -> dict[str, float]:
    """Those doubts that apply to a model's first answers (q,), as values by name; BLIND always.

    Takes their novelty (q,) and the threshold in use, which keeps `kept_precision` on held-out
    blocks where `wanted_precision` was wanted, and the numbers of seen queries and of blocks of the
    path that hold them.
    """
    _, counts = np.unique(answers, return_counts=True)
    commonest_share = counts.max(initial=0) / max(len(answers), 1)
    rejected = novelty.astype(np.float64) >= reject_from
    applies = {
        "doubt_one_answer": (commonest_share, commonest_share >= HALF),
        "doubt_few_seen": (seen, seen <= FEW),
        "doubt_few_blocks": (blocks, blocks <= FEW_BLOCKS),
        "doubt_all_rejected": (1.0, rejected.all() and reject_from > ACCEPT_NOTHING),
        "doubt_none_rejected": (1.0, not rejected.any()),
        "doubt_no_threshold": (1.0, reject_from <= ACCEPT_NOTHING),
        "doubt_less_kept": (kept_precision, kept_precision < wanted_precision),
        VOID: (1.0, not blind < HALF),
    }
    return {BLIND: blind, **_applying(applies)}


def unsuited(submaps: Submaps) -> dict[str, float]:
    """Those of UNSUITED that apply to the submaps of a sequence, as values by name."""
    azimuth_deg, ground_m, highest_m = (
        submaps.appearance[name] for name in ("azimuth_deg", "ground_m", "highest_m")
    )
    left_out = submaps.left_out
    anchors = len(submaps.scans) + sum(left_out.values())
    share = left_out.get("window not yet whole", 0) / anchors
    return _applying(
        {
            "doubt_not_all_round": (azimuth_deg, azimuth_deg < ROUND_DEG),
            "doubt_ground": (ground_m, abs(ground_m) > GROUND_M),
            "doubt_low": (highest_m, highest_m < LOW_M),
            "doubt_windows": (share, share >= HALF),
        }
    )


def _applying(applies: Mapping[str, tuple[float, bool]]) -> dict[str, float]:
    return {name: float(value) for name, (value, is_present) in applies.items() if is_present}
