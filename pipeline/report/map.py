"""What the map of a study shows: queries, answers and views, as typed arrays and pictures in base64, which map.js reads back."""

import io
from base64 import b64encode
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import KDTree

from pipeline import schemas, store
from pipeline.errors import ArtifactError
from pipeline.evaluation.judgement import Evaluation, Judgement
from pipeline.frames import yaw
from pipeline.report.alike import best_shifts, spectra
from pipeline.report.figures.maps import OUTCOMES
from pipeline.report.study import Result, Study, by_sequence, dates
from pipeline.views.scan_context import colours, quantize

NONE = 0xFFFF_FFFF
"""The training row of an answer without a position."""
COLUMNS = 16
"""Views beside each other in a picture."""


def chart(study: Study) -> dict[str, Any]:
    """All that the map of a study shows; without pictures where no model looks at Scan Contexts."""
    found = ((model, Views.read(*(study.find("views", one, model) for one in study.train.split()))) for model in study.models)
    looking, train = next(((model, views) for model, views in found if views), ("", None))
    training = Training(train, KDTree(study.train_xy_m))
    days, sequences = dates(study.results), []
    answers: dict[str, dict[str, Any]] = {model: {} for model in study.models}
    for sequence, results in by_sequence(study.results).items():
        views = Views.read(study.find("views", sequence, looking)) if train else None
        named = {"name": sequence, "label": f"{days[sequence]}, {results[0].days:+d} d"}
        sequences.append(named | _queries(study, results[0], views, training))
        for one in results:
            answers[one.model][sequence] = _answers(one.evaluation, views, training) | {"heading": _headings(study, one)}
    return {
        "simulated": study.simulated,
        "best": study.best,
        "correct_m": study.distance.correct_m,
        "outcomes": [{"name": name, "colour": colour} for name, colour, _ in OUTCOMES],
        "path": packed(study.train_xy_m, "f4"),
        "train": train.picture if train else None,
        "sequences": sequences,
        "answers": {model: given for model, given in answers.items() if given},
    }


def packed(array: NDArray[Any], dtype: str) -> dict[str, str]:
    """An array as map.js reads it back: its type and its bytes, lowest first, in base64."""
    return {"dtype": dtype, "base64": b64encode(np.ascontiguousarray(array).astype(f"<{dtype}").tobytes()).decode()}


@dataclass(frozen=True)
class Views:
    """The Scan Contexts of a sequence, or of all of training, to be shown and to be compared."""

    picture: dict[str, Any]
    spectra: NDArray[np.complex64]

    @classmethod
    def read(cls, *paths: Path) -> Self | None:
        """Of artifacts behind each other; None where one is missing or holds other views."""
        try:
            heights_m = np.concatenate([store.read(path, schemas.VIEWS).load("images") for path in paths])
        except ArtifactError:
            return None
        _, rings, sectors = heights_m.shape
        png = b64encode(picture(heights_m)).decode()
        return cls({"png": png, "columns": COLUMNS, "rings": rings, "sectors": sectors}, spectra(heights_m))


def picture(heights_m: NDArray[np.float32]) -> bytes:
    """A PNG with a palette of views (view, ring, sector), row by row, ring 0 of each on top."""
    views, rings, sectors = heights_m.shape
    pixels = np.pad(quantize(heights_m), ((0, -views % COLUMNS), (0, 0), (0, 0)))
    sheet = Image.fromarray(pixels.reshape(-1, COLUMNS, rings, sectors).swapaxes(1, 2).reshape(-1, COLUMNS * sectors))
    sheet.putpalette(colours("jet").tobytes())
    file = io.BytesIO()
    sheet.save(file, "PNG", optimize=True)
    return file.getvalue()


@dataclass(frozen=True)
class Training:
    """What positions are looked up in."""

    views: Views | None
    tree: KDTree

    def nearest(self, xy_m: NDArray[np.float64], views: Views | None) -> dict[str, dict[str, str]]:
        """The training row nearest to each position (q, 2), and by how many columns to roll its view to look like the query."""
        rows, shifts = np.full(len(xy_m), NONE, np.int64), np.zeros(len(xy_m), np.int64)
        finite = np.isfinite(xy_m).all(axis=1)
        rows[finite] = self.tree.query(xy_m[finite])[1]
        if views and self.views:
            shifts[finite] = best_shifts(views.spectra[finite], self.views.spectra[rows[finite]], views.picture["sectors"])
        return {"row": packed(rows, "u4"), "shift": packed(shifts, "u2")}


def _queries(study: Study, result: Result, views: Views | None, training: Training) -> dict[str, Any]:
    """What is true of the queries of a sequence, whatever the model."""
    evaluation = result.evaluation
    path = study.find("views", result.sequence, result.model)
    return {
        "xy": packed(evaluation.xy_m, "f4"),
        "heading": packed(np.rad2deg(yaw(store.read(path, *schemas.LOOKED_AT).load("world_T_anchor"))), "f4"),
        "nearest_m": packed(evaluation.nearest_m, "f4"),
        **training.nearest(evaluation.xy_m, views),
        "views": views.picture if views else None,
    }


def _answers(evaluation: Evaluation, views: Views | None, training: Training) -> dict[str, Any]:
    """What one model answered to them, and the outcomes by both protocols."""

    def judged(by: Judgement) -> dict[str, dict[str, str]]:
        return {"outcome": packed(by.outcome, "i1"), "rank": packed(by.true_rank, "i2"), "seen": packed(by.seen, "u1")}

    return {
        "distance": judged(evaluation.distance),
        "cells": judged(evaluation.cells),
        "xy": packed(evaluation.answer_xy_m, "f4"),
        "novelty": packed(evaluation.novelty[:, 0], "f4"),
        "kind": evaluation.kinds[0],
        "threshold": evaluation.reject_from[0],
        **training.nearest(evaluation.answer_xy_m, views),
    }


def _headings(study: Study, result: Result) -> dict[str, str] | None:
    """The headings (q,) of the first answers to the queries as driven, whose rows come first; None where the model gives none."""
    try:
        heading_deg = store.read(study.find("localize", result.sequence, result.model), schemas.RANKINGS).load("heading_deg")
    except ArtifactError:
        return None
    first_deg = heading_deg.reshape(len(heading_deg), -1)[: len(result.evaluation.xy_m), 0]
    return packed(first_deg, "f4") if np.isfinite(first_deg).any() else None
