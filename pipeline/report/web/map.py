"""The data of a study's map: queries, answers and views.

Arrays and pictures are written in base64, which map.js reads back.
"""

import io
from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import KDTree

from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError
from pipeline.core.frames import yaw
from pipeline.report.alike import best_shifts, spectra
from pipeline.report.figures.maps import ANSWERS
from pipeline.report.result import Result, by_sequence, dates
from pipeline.report.study import Study
from pipeline.views.scan_context import colours, quantize

NONE = 0xFFFF_FFFF  # the training row of an answer without a position
COLUMNS = 16  # views beside each other in a picture


def chart(study: Study) -> dict[str, Any]:
    """All data of a study's map; without pictures where no model looks at Scan Contexts."""
    candidates = (
        (
            model,
            Views.read(*(study.find("views", sequence, model) for sequence in study.train.split())),
        )
        for model in study.models
    )
    view_model, train = next(((model, views) for model, views in candidates if views), ("", None))
    training = Training(train, KDTree(study.train_xy_m))
    # float32 as far out as UTM would take decimetres
    origin_m = np.rint(study.train_xy_m.mean(axis=0))
    days = dates(study.results)
    sequences = []
    answers: dict[str, dict[str, Any]] = {model: {} for model in study.models}
    for sequence, results in by_sequence(study.results).items():
        first = results[0]
        views = Views.read(study.find("views", sequence, view_model)) if train else None
        looked_at = store.read(study.find("views", sequence, first.model), *schemas.VIEW_KINDS)
        sequences.append(
            {
                "name": sequence,
                "label": f"{days[sequence]}, {first.days:+d} d",
                "xy": packed(first.evaluation.xy_m - origin_m, "f4"),
                "heading": packed(np.rad2deg(yaw(looked_at.load("world_T_anchor"))), "f4"),
                "nearest_m": packed(first.evaluation.nearest_m, "f4"),
                **training.nearest(first.evaluation.xy_m, views),
                "views": views.picture if views else None,
            }
        )
        for result in results:
            answers[result.model][sequence] = _answers(study, result, views, training, origin_m)
    return {
        "simulated": study.simulated,
        "best": study.best,
        "correct_m": study.distance.correct_m,
        "kinds": [{"name": name, "colour": colour} for name, colour, _ in ANSWERS],
        "path": packed(study.train_xy_m - origin_m, "f4"),
        "train": train.picture if train else None,
        "sequences": sequences,
        "answers": {
            model: model_answers for model, model_answers in answers.items() if model_answers
        },
    }


def packed(array: NDArray[Any], dtype: str) -> dict[str, str]:
    """An array as map.js reads it: its type, and its bytes (little-endian) in base64."""
    return {
        "dtype": dtype,
        "base64": b64encode(np.ascontiguousarray(array).astype(f"<{dtype}").tobytes()).decode(),
    }


@dataclass(frozen=True)
class Views:
    """The Scan Contexts of a sequence or of all training sequences, as a picture and as spectra."""

    picture: dict[str, Any]
    spectra: NDArray[np.complex64]

    @classmethod
    def read(cls, *paths: Path) -> Self | None:
        """Read artifacts one after the other; None where one is missing or holds other views."""
        try:
            heights_m = np.concatenate(
                [store.read(path, schemas.ScanContextViews).load("images") for path in paths]
            )
        except ArtifactError:
            return None
        _, rings, sectors = heights_m.shape
        png = b64encode(picture(heights_m)).decode()
        return cls(
            {"png": png, "columns": COLUMNS, "rings": rings, "sectors": sectors}, spectra(heights_m)
        )


def picture(heights_m: NDArray[np.float32]) -> bytes:
    """A PNG with a palette of views (view, ring, sector), in rows of COLUMNS, ring 0 on top."""
    views, rings, sectors = heights_m.shape
    pixels = np.pad(quantize(heights_m), ((0, -views % COLUMNS), (0, 0), (0, 0)))
    sheet = Image.fromarray(
        pixels.reshape(-1, COLUMNS, rings, sectors).swapaxes(1, 2).reshape(-1, COLUMNS * sectors)
    )
    sheet.putpalette(colours("jet").tobytes())
    file = io.BytesIO()
    sheet.save(file, "PNG", optimize=True)
    return file.getvalue()


@dataclass(frozen=True)
class Training:
    """The training views and positions, in which positions are looked up."""

    views: Views | None
    tree: KDTree

    def nearest(self, xy_m: NDArray[np.float64], views: Views | None) -> dict[str, dict[str, str]]:
        """The training row nearest to each position (q, 2), and the shift of its view.

        The shift is the number of columns to roll the view by so that it looks like the query.
        """
        rows = np.full(len(xy_m), NONE, np.int64)
        shifts = np.zeros(len(xy_m), np.int64)
        finite = np.isfinite(xy_m).all(axis=1)
        rows[finite] = self.tree.query(xy_m[finite])[1]
        if views and self.views:
            shifts[finite] = best_shifts(
                views.spectra[finite], self.views.spectra[rows[finite]], views.picture["sectors"]
            )
        return {"row": packed(rows, "u4"), "shift": packed(shifts, "u2")}


def _answers(
    study: Study,
    result: Result,
    views: Views | None,
    training: Training,
    origin_m: NDArray[np.float64],
) -> dict[str, Any]:
    """The answers of one model, with outcomes by both protocols.

    Headings (q,) are of queries as driven, whose rows come first.
    """
    evaluation = result.evaluation
    count = len(result.evaluation.xy_m)
    try:
        rankings = store.read(
            study.find("localize", result.sequence, result.model), schemas.Rankings, schemas.Fixes
        )
        first_deg = rankings.load("heading_deg")[:count, 0]
    except ArtifactError:
        first_deg = np.full(count, np.nan)
    answers = {
        "xy": packed(evaluation.answer_xy_m - origin_m, "f4"),
        "novelty": packed(evaluation.novelty[:, 0], "f4"),
        "kind": evaluation.kinds[0],
        "threshold": evaluation.reject_from[0],
        "heading": packed(first_deg, "f4") if np.isfinite(first_deg).any() else None,
    }
    for protocol, judgement in (("distance", evaluation.distance), ("cells", evaluation.cells)):
        outcomes = {
            "outcome": packed(judgement.outcome, "i1"),
            "rank": packed(judgement.true_rank, "i2"),
            "seen": packed(judgement.seen, "u1"),
        }
        answers[protocol] = outcomes
    return answers | training.nearest(evaluation.answer_xy_m, views)
