"""The data of the page's map of a study: paths, queries, answers, views and scans.

In: a study. Out: `chart`, which is JSON: numbers are rounded to whole steps and packed in base64,
and views and the footprint are small PNGs. templates/map.js reads it back and draws the map.
"""

import math
from base64 import b64encode
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial import KDTree

from pipeline.core import schemas, store
from pipeline.core.errors import ArtifactError
from pipeline.core.frames import yaw
from pipeline.evaluation import evaluations as judged
from pipeline.evaluation.evaluations import Evaluation, Judgement
from pipeline.mapping.from_above import CELL_M, Footprint
from pipeline.report.alignment import best_shifts, spectra
from pipeline.report.figures.maps import RIGHT, WRONG, answers
from pipeline.report.figures.style import png_text
from pipeline.report.result import Result, by_sequence, dates
from pipeline.report.study import StudyResults
from pipeline.views.scan_context import colours, quantize

COLUMNS = 16  # views beside each other in a picture
LEVELS = 32  # of the heights in a picture
MOST_KEPT = 200  # queries of a study, of all days, whose view and points the page keeps
# Steps that numbers are rounded to.
STEP_M = 0.05
STEP_DEG = 0.1
NOVELTY_STEPS = 30_000  # from 0 to the largest novelty
# What an answer is, as map.js reads it; ACCEPTED is added to the code of an accepted one.
NOT_JUDGED = 3  # after the codes RIGHT, WRONG and UNSEEN of figures/maps.py
ACCEPTED = 4
MOST_RANKS = 120  # ranks of the true place beyond this are cut, to fit into a byte


def chart(study: StudyResults) -> dict[str, Any]:
    """All data of a study's map.

    It has no views if no model takes Scan Contexts or their files are missing, and no footprint and
    points if the scans are missing.
    """
    views_of = ((model, Views.read(study, model, *study.train.split())) for model in study.models)
    view_model, train = next(((model, views) for model, views in views_of if views), ("", None))
    nearest_training = partial(nearest, KDTree(study.train_xy_m), train)
    footprint = study.footprint
    origin_m = np.rint(study.train_xy_m.mean(axis=0))  # is subtracted, so that numbers are small
    days = dates(study.results)
    sequences = []
    by_model: dict[str, dict[str, Any]] = {model: {} for model in study.models}
    for sequence, results in by_sequence(study.results).items():
        evaluation = results[0].evaluation  # where queries were taken is the same in all
        best = next((result for result in results if result.model == study.best), results[0])
        kept = _kept_queries(best.evaluation.acceptance, MOST_KEPT // len(days))
        views = Views.read(study, view_model, sequence) if train else None
        looked_at = store.read(study.find("views", sequence, results[0].model), *schemas.VIEW_KINDS)
        heading_deg = np.rad2deg(yaw(looked_at.load("world_T_anchor")))
        sequences.append(
            {
                "name": sequence,
                "label": f"{days[sequence]}, {results[0].days:+d} d",
                "xy": quantized(evaluation.xy_m - origin_m, STEP_M),
                "heading": quantized(heading_deg, STEP_DEG),
                "nearest_m": quantized(evaluation.nearest_m, STEP_M),
                **nearest_training(evaluation.xy_m, views),
                "kept": indices(kept),
                "views": views.picture(kept) if views else None,
                "scans": _scans(study, sequence, kept) if footprint else None,
            }
        )
        for result in results:
            matched = nearest_training(result.evaluation.answer_xy_m, views)
            by_model[result.model][sequence] = _answers(study, result, origin_m) | matched
    return {
        "simulated": study.simulated,
        "best": study.best,
        "correct_m": study.distance.correct_m,
        "path": quantized(study.train_xy_m - origin_m, STEP_M),
        "footprint": _ground(footprint, origin_m) if footprint else None,
        "train": train.picture() if train else None,
        "sequences": sequences,
        "answers": {model: by_day for model, by_day in by_model.items() if by_day},
    }


def _ground(footprint: Footprint, origin_m: NDArray[np.float64]) -> dict[str, Any]:
    """The footprint of training as a picture, and where its corner lies."""
    corner = (footprint.corner_m - origin_m).round(2).tolist()
    png = png_text(Image.fromarray(footprint.occupied[::-1]), transparency=0)
    return {"png": png, "corner": corner, "cell_m": footprint.cell_m}


def packed(array: NDArray[Any], dtype: str) -> dict[str, Any]:
    """An array as map.js reads it: its type, and its bytes (little-endian) in base64."""
    content = np.ascontiguousarray(array).astype(f"<{dtype}").tobytes()
    return {"dtype": dtype, "base64": b64encode(content).decode()}


def quantized(values: NDArray[np.floating], step: float) -> dict[str, Any]:
    """Numbers rounded to whole steps, in two bytes each if they fit, else in four.

    A number that is not finite becomes the lowest one of the type, which map.js reads as NaN.
    """
    finite = np.isfinite(values)
    steps = np.rint(np.where(finite, values, 0.0) / step).astype(np.int64)
    dtype = "i2" if np.abs(steps).max(initial=0) <= np.iinfo(np.int16).max else "i4"
    missing = np.iinfo(dtype).min
    return packed(np.where(finite, steps, missing), dtype) | {"step": step, "missing": missing}


def indices(values: NDArray[np.integer]) -> dict[str, Any]:
    """Whole numbers from 0 on; −1, which means none, becomes the largest number of the type."""
    dtype = "u2" if values.max(initial=0) < np.iinfo(np.uint16).max else "u4"
    return packed(np.where(values < 0, np.iinfo(dtype).max, values), dtype)


@dataclass(frozen=True)
class Views:
    """The Scan Contexts of a sequence or of all training sequences."""

    heights_m: NDArray[np.float32]  # (view, ring, sector)
    spectra: NDArray[np.complex64]  # (view, ring, frequency), see `alignment`

    @classmethod
    def read(cls, study: StudyResults, model: str, *sequences: str) -> Self | None:
        """Read the Scan Contexts that a model looks at; None if they are others or not here."""
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
        png = png_text(sheet(heights_m))
        return {"png": png, "columns": COLUMNS, "rings": rings, "sectors": sectors}


def sheet(heights_m: NDArray[np.float32]) -> Image.Image:
    """Views (view, ring, sector) as one image with a palette, in rows of COLUMNS, ring 0 on top."""
    views, rings, sectors = heights_m.shape
    step = 256 // LEVELS
    rounded_up = -(-quantize(heights_m).astype(np.int64) // step) * step
    levels = np.minimum(rounded_up, 255)
    pixels = np.pad(levels.astype(np.uint8), ((0, -views % COLUMNS), (0, 0), (0, 0)))
    image = Image.fromarray(
        pixels.reshape(-1, COLUMNS, rings, sectors).swapaxes(1, 2).reshape(-1, COLUMNS * sectors)
    )
    image.putpalette(colours("jet").tobytes())
    return image


def nearest(
    tree: KDTree, train: Views | None, xy_m: NDArray[np.float64], views: Views | None
) -> dict[str, dict[str, str]]:
    """The training submap nearest to each position (q, 2), and the shift of its view.

    `tree` holds the positions of training, `train` its views, and `views` are those of the queries.
    The shift is the number of columns to roll a training view by so that it looks most like the
    query's.
    """
    rows = np.full(len(xy_m), -1)
    shifts = np.zeros(len(xy_m), np.int64)
    finite = np.isfinite(xy_m).all(axis=1)
    rows[finite] = tree.query(xy_m[finite])[1]
    if views and train:
        shifts[finite] = best_shifts(
            views.spectra[finite], train.spectra[rows[finite]], views.heights_m.shape[2]
        )
    return {"row": indices(rows), "shift": indices(shifts)}


def _answers(
    study: StudyResults,
    result: Result,
    origin_m: NDArray[np.float64],
) -> dict[str, Any]:
    """The answers of one model on one sequence, and how they are judged."""
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
    shown = {
        "posed": result.posed,
        "right_within": list(evaluation.right_within),
        "xy": quantized(evaluation.answer_xy_m - origin_m, STEP_M),
        "novelty": quantized(novelty, largest / NOVELTY_STEPS),
        "kind": evaluation.kinds[0],
        "threshold": float(threshold),
        "heading": quantized(first_deg, STEP_DEG) if np.isfinite(first_deg).any() else None,
        "accepted": {"code": packed(_acceptance_code(evaluation), "u1")},
    }
    for protocol, judgement in (("distance", evaluation.distance), ("cells", evaluation.cells)):
        ranks = np.minimum(judgement.true_rank, MOST_RANKS)
        shown[protocol] = {"code": packed(_code(judgement), "u1"), "rank": packed(ranks, "i1")}
    return shown


def _code(judgement: Judgement) -> NDArray[np.int64]:
    """The code of each answer (q,) by one protocol: RIGHT to NOT_JUDGED, ACCEPTED or not."""
    kinds, accepted = answers(judgement)
    code = np.where(judgement.outcome == judged.NOT_JUDGED, NOT_JUDGED, kinds)
    return np.asarray(code + ACCEPTED * accepted)


def _acceptance_code(evaluation: Evaluation) -> NDArray[np.int64]:
    """The code of each answer (q,) by its verdict: whether it is accepted, and right or wrong.

    The answer is the pose if the model has poses, else the place.
    """
    acceptance = evaluation.acceptance
    wrong = acceptance["accepted_wrong"] | acceptance["refused_wrong"]
    code = np.where(wrong, WRONG, RIGHT)
    code[~(acceptance["accepted"] | acceptance["refused"])] = NOT_JUDGED
    if not np.isnan(evaluation.reject_pose_from):
        code[np.isnan(evaluation.pose_error_m)] = NOT_JUDGED
    return np.asarray(code + ACCEPTED * acceptance["accepted"])


def _kept_queries(acceptance: Mapping[str, NDArray[np.bool_]], most: int) -> NDArray[np.int64]:
    """The queries of a day to keep.

    All wrong answers that were accepted, some wrong answers that were refused, and others evenly.
    """
    wrong = np.flatnonzero(acceptance["accepted_wrong"])
    refused = np.flatnonzero(acceptance["refused_wrong"])
    refused = refused[:: max(math.ceil(3 * len(refused) / most), 1)]  # a third of the room
    room = max(most - len(wrong) - len(refused), 1)
    evenly = np.linspace(0, len(acceptance["accepted"]) - 1, room).astype(np.int64)
    return np.asarray(np.unique(np.concatenate([wrong, refused, evenly])), np.int64)


def _scans(study: StudyResults, sequence: str, rows: NDArray[np.int64]) -> dict[str, Any] | None:
    """The points of some submaps of a drive; None if its scans are missing."""
    try:
        drive = study.drive(sequence)
    except ArtifactError:
        return None
    cells = [drive.cells(row) for row in rows]
    return {
        "first": indices(np.cumsum([0, *map(len, cells)])),
        "cells": packed(np.concatenate(cells), "i1"),
        "cell_m": CELL_M,
    }
