"""What the page's map is drawn from: queries, answers and views of one study, as small typed arrays in base64."""

from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from pipeline import schemas, store
from pipeline.errors import ArtifactError
from pipeline.frames import yaw
from pipeline.leaflet.atlas import Atlas, shifts, spectra
from pipeline.reports.maps import OUTCOMES
from pipeline.reports.result import Result, by_sequence, dates
from pipeline.reports.study import Study

NONE = 0xFFFF
"""The row of an answer without a position."""


@dataclass(frozen=True)
class Looks:
    """The Scan Contexts of one sequence."""

    atlas: Atlas
    spectra: NDArray[np.complex64]

    @classmethod
    def read(cls, study: Study, sequence: str, method: str) -> "Looks":
        """Those that a method looks at."""
        images = store.read(study.find("views", sequence, method), schemas.VIEWS).load("images")
        return cls(Atlas.of(images), spectra(images))


def chart(study: Study, artifacts: Path, best: str) -> dict[str, Any]:
    """All that the map of a study shows; without pictures where no method looks at Scan Contexts."""
    method = looker(study)
    train = Looks.read(study, study.train, method) if method else None
    tree, days = KDTree(study.train_xy_m), dates(study.results)
    sequences: list[dict[str, Any]] = []
    answers: dict[str, dict[str, Any]] = {method: {} for method in study.models}
    for sequence, group in by_sequence(study.results).items():
        looks = Looks.read(study, sequence, method) if method else None
        sequences.append(_sequence(study, sequence, group[0], looks, train, tree, days[sequence]))
        for result in group:
            heading_deg = _told_heading(artifacts, study, result)
            answers[result.method][sequence] = _answers(result, heading_deg, looks, train, tree)
    return {
        "study": f"{study.dataset} {study.grid}",
        "simulated": study.simulated,
        "best": best,
        "correct_m": study.distance.correct_m,
        "cell_m": study.cell_m,
        "outcomes": [{"name": name, "colour": colour} for name, colour, _ in OUTCOMES],
        "path": packed(study.train_xy_m, "<f4"),
        "train": train.atlas.told() if train else None,
        "sequences": sequences,
        "answers": answers,
    }


def looker(study: Study) -> str:
    """The first method that looks at Scan Contexts; empty for none."""
    for method in study.models:
        try:
            store.read(study.find("views", study.train, method), schemas.VIEWS)
        except ArtifactError:
            continue
        return method
    return ""


def packed(array: NDArray[Any], dtype: str) -> str:
    """An array's bytes in base64."""
    return b64encode(np.ascontiguousarray(array).astype(dtype).tobytes()).decode()


def _sequence(
    study: Study, sequence: str, result: Result, looks: Looks | None, train: Looks | None, tree: KDTree, day: str
) -> dict[str, Any]:
    """What is true of its queries, whatever the method."""
    evaluation = result.evaluation
    world_T_anchor = store.read(study.find("views", sequence, result.method), *schemas.LOOKED_AT).load("world_T_anchor")
    rows, turned = _nearest(evaluation.xy_m, looks, train, tree)
    return {
        "name": sequence,
        "label": f"{day}, {result.days:+d} d",
        "xy": packed(evaluation.xy_m, "<f4"),
        "heading": packed(np.rad2deg(yaw(world_T_anchor)), "<f4"),
        "nearest_m": packed(evaluation.nearest_m, "<f4"),
        "row": packed(rows, "<u2"),
        "turned": packed(turned, "<u2"),
        "atlas": looks.atlas.told() if looks else None,
    }


def _answers(
    result: Result, heading_deg: NDArray[np.float32] | None, looks: Looks | None, train: Looks | None, tree: KDTree
) -> dict[str, Any]:
    """What one method said of them, and what became of it."""
    evaluation = result.evaluation
    rows, turned = _nearest(evaluation.answer_xy_m, looks, train, tree)
    judged = {
        name: {"outcome": packed(by.outcome, "<i1"), "rank": packed(by.true_rank, "<i2"), "seen": packed(by.seen, "<u1")}
        for name, by in (("distance", evaluation.distance), ("cells", evaluation.cells))
    }
    return {
        **judged,
        "xy": packed(evaluation.answer_xy_m, "<f4"),
        "novelty": packed(evaluation.novelty[:, 0], "<f4"),
        "kind": evaluation.kinds[0],
        "threshold": evaluation.reject_from[0],
        "heading": None if heading_deg is None else packed(heading_deg, "<f4"),
        "row": packed(rows, "<u2"),
        "turned": packed(turned, "<u2"),
    }


def _nearest(
    xy_m: NDArray[np.float64], looks: Looks | None, train: Looks | None, tree: KDTree
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The training row (q,) nearest to each position (q, 2), and by how many columns its view is to be rolled."""
    rows, turned = np.full(len(xy_m), NONE), np.zeros(len(xy_m), np.int64)
    there = np.isfinite(xy_m).all(axis=1)
    rows[there] = tree.query(xy_m[there])[1]
    if looks and train:
        turned[there] = shifts(looks.spectra[there], train.spectra[rows[there]], train.atlas.sectors)
    return rows, turned


def _told_heading(artifacts: Path, study: Study, result: Result) -> NDArray[np.float32] | None:
    """The headings (q,) that a method told; None where it tells none."""
    if not np.isfinite(result.evaluation.heading_error_deg).any():
        return None
    path = artifacts / "localize" / study.dataset / study.grid / result.method / f"{result.sequence}.zarr"
    try:
        told: NDArray[np.float32] = store.read(path, schemas.RANKINGS).load("heading_deg")
    except ArtifactError:
        return None
    return told
