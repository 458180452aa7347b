"""The data of a study's map: queries, answers and views.

Arrays and pictures are written in base64, which map.js reads back.
"""

from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import KDTree

from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError
from pipeline.core.frames import yaw
from pipeline.evaluation import judgement as judged
from pipeline.evaluation.judgement import Evaluation
from pipeline.report.alignment import best_shifts, spectra
from pipeline.report.clouds import CELL_M, Drive, Footprint
from pipeline.report.figures.style import png_text
from pipeline.report.result import Result, by_sequence, dates
from pipeline.report.study import Study
from pipeline.views.scan_context import colours, quantize

COLUMNS = 16  # views beside each other in a picture
LEVELS = 32  # of the heights in a picture
KEPT = 200  # queries of a study whose view and points a page keeps, on all days together
STEP_M = 0.05
STEP_DEG = 0.1
NOVELTY_STEPS = 30_000
RIGHT, WRONG, UNSEEN, NOT_JUDGED = range(4)
"""What an answer is, as map.js counts; ACCEPTED is added to it."""
ACCEPTED = 4
MOST_RANKS = 120


def chart(study: Study) -> dict[str, Any]:
    """All data of a study's map.

    There are no pictures where no model looks at Scan Contexts, and no clouds where the scans are
    not here.
    """
    views_of = ((model, Views.read(study, model, *study.train.split())) for model in study.models)
    view_model, train = next(((model, views) for model, views in views_of if views), ("", None))
    training = Training(train, KDTree(study.train_xy_m))
    footprint = Footprint.read(study)
    # of what is packed, for few digits
    origin_m = np.rint(study.train_xy_m.mean(axis=0))
    days = dates(study.results)
    sequences = []
    answers: dict[str, dict[str, Any]] = {model: {} for model in study.models}
    for sequence, results in by_sequence(study.results).items():
        first = results[0].evaluation
        best = next((result for result in results if result.model == study.best), results[0])
        kept = _kept(best.evaluation.acceptance, KEPT // len(days))
        views = Views.read(study, view_model, sequence) if train else None
        looked_at = store.read(study.find("views", sequence, results[0].model), *schemas.VIEW_KINDS)
        sequences.append(
            {
                "name": sequence,
                "label": f"{days[sequence]}, {results[0].days:+d} d",
                "xy": quantized(first.xy_m - origin_m, STEP_M),
                "heading": quantized(np.rad2deg(yaw(looked_at.load("world_T_anchor"))), STEP_DEG),
                "nearest_m": quantized(first.nearest_m, STEP_M),
                **training.nearest(first.xy_m, views),
                "kept": indices(kept),
                "views": views.picture(kept) if views else None,
                "scans": _scans(study, sequence, kept) if footprint else None,
            }
        )
        for result in results:
            answers[result.model][sequence] = _answers(study, result, views, training, origin_m)
    return {
        "simulated": study.simulated,
        "best": study.best,
        "correct_m": study.distance.correct_m,
        "path": quantized(study.train_xy_m - origin_m, STEP_M),
        "footprint": footprint
        and {
            "png": footprint.png(),
            "corner": (footprint.corner_m - origin_m).round(2).tolist(),
            "cell_m": footprint.cell_m,
        },
        "train": train.picture() if train else None,
        "sequences": sequences,
        "answers": {
            model: model_answers for model, model_answers in answers.items() if model_answers
        },
    }


def packed(array: NDArray[Any], dtype: str) -> dict[str, Any]:
    """An array as map.js reads it: its type, and its bytes (little-endian) in base64."""
    return {
        "dtype": dtype,
        "base64": b64encode(np.ascontiguousarray(array).astype(f"<{dtype}").tobytes()).decode(),
    }


def quantized(values: NDArray[np.floating], step: float) -> dict[str, Any]:
    """Numbers in whole steps, in two bytes each if they fit, else in four.

    What is not finite becomes the lowest number of the type, which map.js reads as NaN.
    """
    finite = np.isfinite(values)
    steps = np.rint(np.where(finite, values, 0.0) / step).astype(np.int64)
    dtype = "i2" if np.abs(steps).max(initial=0) <= np.iinfo(np.int16).max else "i4"
    missing = np.iinfo(dtype).min
    return packed(np.where(finite, steps, missing), dtype) | {"step": step, "missing": missing}


def indices(values: NDArray[np.integer]) -> dict[str, Any]:
    """Whole numbers from 0 on; −1, which is none, becomes the type's largest number."""
    dtype = "u2" if values.max(initial=0) < np.iinfo(np.uint16).max else "u4"
    return packed(np.where(values < 0, np.iinfo(dtype).max, values), dtype)


@dataclass(frozen=True)
class Views:
    """The Scan Contexts of a sequence or of all training sequences."""

    heights_m: NDArray[np.float32]  # (view, ring, sector)
    spectra: NDArray[np.complex64]

    @classmethod
    def read(cls, study: Study, model: str, *sequences: str) -> Self | None:
        """Read what a model looks at; None where that is missing or other views."""
        paths = [study.find("views", sequence, model) for sequence in sequences]
        try:
            images = [store.read(path, schemas.ScanContextViews).load("images") for path in paths]
        except ArtifactError:
            return None
        heights_m = np.concatenate(images)
        return cls(heights_m, spectra(heights_m))

    def picture(self, rows: NDArray[np.int64] | slice = slice(None)) -> dict[str, Any]:
        """Some of the views as map.js draws them, in one picture."""
        heights_m = self.heights_m[rows]
        _, rings, sectors = heights_m.shape
        png = png_text(picture(heights_m))
        return {"png": png, "columns": COLUMNS, "rings": rings, "sectors": sectors}


def picture(heights_m: NDArray[np.float32]) -> Image.Image:
    """Views (view, ring, sector) with a palette, in rows of COLUMNS, ring 0 on top."""
    views, rings, sectors = heights_m.shape
    wide = 256 // LEVELS
    levels = np.minimum(-(-quantize(heights_m).astype(np.int64) // wide) * wide, 255)
    pixels = np.pad(levels.astype(np.uint8), ((0, -views % COLUMNS), (0, 0), (0, 0)))
    sheet = Image.fromarray(
        pixels.reshape(-1, COLUMNS, rings, sectors).swapaxes(1, 2).reshape(-1, COLUMNS * sectors)
    )
    sheet.putpalette(colours("jet").tobytes())
    return sheet


@dataclass(frozen=True)
class Training:
    """The training views and positions, in which positions are looked up."""

    views: Views | None
    tree: KDTree

    def nearest(self, xy_m: NDArray[np.float64], views: Views | None) -> dict[str, dict[str, str]]:
        """The training row nearest to each position (q, 2), and the shift of its view.

        The shift is the number of columns to roll the view by so that it looks like the query.
        """
        rows = np.full(len(xy_m), -1)
        shifts = np.zeros(len(xy_m), np.int64)
        finite = np.isfinite(xy_m).all(axis=1)
        rows[finite] = self.tree.query(xy_m[finite])[1]
        if views and self.views:
            shifts[finite] = best_shifts(
                views.spectra[finite], self.views.spectra[rows[finite]], views.heights_m.shape[2]
            )
        return {"row": indices(rows), "shift": indices(shifts)}


def _answers(
    study: Study,
    result: Result,
    views: Views | None,
    training: Training,
    origin_m: NDArray[np.float64],
) -> dict[str, Any]:
    """The answers of one model, and what they are: as believed, by distance and by cells.

    Headings (q,) are of queries as driven, whose rows come first.
    """
    evaluation = result.evaluation
    count = len(evaluation.xy_m)
    try:
        rankings = store.read(
            study.find("localize", result.sequence, result.model), schemas.Rankings, schemas.Fixes
        )
        first_deg = rankings.load("heading_deg")[:count, 0]
    except ArtifactError:
        first_deg = np.full(count, np.nan)
    novelty = evaluation.novelty[:, 0].astype(np.float64)
    largest = np.abs(novelty[np.isfinite(novelty)]).max(initial=1e-9)
    threshold = evaluation.reject_pose_from if result.posed else evaluation.reject_from[0]
    answers = {
        "posed": result.posed,
        "right_within": list(evaluation.right_within),
        "xy": quantized(evaluation.answer_xy_m - origin_m, STEP_M),
        "novelty": quantized(novelty, largest / NOVELTY_STEPS),
        "kind": evaluation.kinds[0],
        "threshold": float(threshold),
        "heading": quantized(first_deg, STEP_DEG) if np.isfinite(first_deg).any() else None,
        "believed": {"code": packed(_belief(evaluation), "u1")},
    }
    for protocol, judgement in (("distance", evaluation.distance), ("cells", evaluation.cells)):
        first_right = np.where(judgement.true_rank == 0, RIGHT, WRONG)
        code = np.where(judgement.seen, first_right, UNSEEN)
        code[judgement.outcome == judged.NOT_JUDGED] = NOT_JUDGED
        code += ACCEPTED * np.isin(judgement.outcome, (judged.HIT, judged.FALSE_ALARM))
        ranks = np.minimum(judgement.true_rank, MOST_RANKS)
        answers[protocol] = {"code": packed(code, "u1"), "rank": packed(ranks, "i1")}
    return answers | training.nearest(evaluation.answer_xy_m, views)


def _belief(evaluation: Evaluation) -> NDArray[np.int64]:
    """What each answer (q,) is as it is believed: right or wrong, and ACCEPTED or not."""
    believed = evaluation.acceptance
    wrong = believed["accepted_wrong"] | believed["refused_wrong"]
    code = np.where(wrong, WRONG, RIGHT)
    code[~(believed["accepted"] | believed["refused"])] = NOT_JUDGED
    if not np.isnan(evaluation.reject_pose_from):
        code[np.isnan(evaluation.pose_error_m)] = NOT_JUDGED
    return np.asarray(code + ACCEPTED * believed["accepted"])


def _kept(believed: Mapping[str, NDArray[np.bool_]], most: int) -> NDArray[np.int64]:
    """The queries of a day to look at: the believed wrong ones, some refused ones, others evenly.

    There are at most `most`, or as many as were believed wrongly.
    """
    wrong = np.flatnonzero(believed["accepted_wrong"])
    refused = np.flatnonzero(believed["refused_wrong"])
    refused = refused[:: max(-(-3 * len(refused) // most), 1)]
    room = max(most - len(wrong) - len(refused), 1)
    evenly = np.linspace(0, len(believed["accepted"]) - 1, room).astype(np.int64)
    return np.asarray(np.unique(np.concatenate([wrong, refused, evenly])), np.int64)


def _scans(study: Study, sequence: str, rows: NDArray[np.int64]) -> dict[str, Any] | None:
    """The points of some submaps of a drive; None where its scans are not here."""
    try:
        drive = Drive.read(study, sequence)
    except ArtifactError:
        return None
    cells = [drive.cells(row) for row in rows]
    return {
        "first": indices(np.cumsum([0, *map(len, cells)])),
        "cells": packed(np.concatenate(cells), "i1"),
        "cell_m": CELL_M,
    }
