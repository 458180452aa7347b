"""The key numbers of each kind of artifact: what a person would compute first."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.inspection.columns import BLOCK
from pipeline.inspection.inspection import Section, duration, metres, moment
from pipeline.inspection.survey import spread, survey
from pipeline.store import Artifact

VEHICLE = "vehicle frame: x forward, y left, z up, ground at 0"


@dataclass(frozen=True)
class Highlights:
    """What stands above the arrays, and what is wrong."""

    sections: tuple[Section, ...] = ()
    warnings: tuple[str, ...] = ()


def of(kind: str, artifact: Artifact) -> Highlights:
    """Key numbers of an artifact that has rows; nothing for a kind without any."""
    return KINDS[kind](artifact) if kind in KINDS else Highlights()


def _scans(artifact: Artifact) -> Highlights:
    drive, warnings = _drive(artifact, "world_T_scan", "scans")
    offsets, grain_m = artifact.load("offsets"), float(artifact.attrs["grain_m"])
    sizes = np.diff(offsets)
    posed = np.isfinite(artifact.load("odom_T_scan")).all(axis=(1, 2))
    if len(sizes):
        drive += [
            (
                "points a scan",
                f"{sizes.min():,} … {sizes.max():,}, median {np.median(sizes):,.0f}; grain {1000 * grain_m:.3g} mm",
            ),
            ("odometry", f"at {100 * posed.mean():.3g} % of the scans"),
        ]
    if (sizes < 0).any() or offsets[-1] != artifact["points"].shape[0]:
        return Highlights((Section("", tuple(drive)),), (*warnings, "offsets do not fit the points: `dvc repro` the scans"))

    def points(row: int) -> NDArray[np.float64]:
        return np.asarray(artifact["points"][offsets[row] : offsets[row + 1]], np.float64) * grain_m

    clouds, found = survey(spread(len(sizes)), points, VEHICLE)
    if (sizes == 0).any():
        warnings.append(f"{int((sizes == 0).sum())} scans hold no point: their views would be blank; look at the log's files")
    return Highlights((Section("", tuple(drive)), clouds), (*warnings, *found))


def _submaps(artifact: Artifact) -> Highlights:
    drive, warnings = _drive(artifact, "world_T_anchor", "submaps")
    return Highlights((Section("", tuple(drive)),), tuple(warnings))


def _views(artifact: Artifact) -> Highlights:
    drive, warnings = _drive(artifact, "world_T_anchor", "views")
    images = artifact["images"]
    shape, count = images.shape, int(np.prod(images.shape))
    step = max(1, BLOCK // max(1, int(np.prod(shape[1:]))))
    empty, blank, highest = 0, 0, -np.inf
    for start in range(0, shape[0], step):
        block = np.asarray(images[start : start + step])
        filled = (block != 0).reshape(len(block), -1)
        empty += int((~filled).sum())
        blank += int((~filled.any(axis=1)).sum())
        highest = max(highest, float(block.max()))
    if count:
        drive += [("empty bins", f"{100 * empty / count:.1f} %"), ("highest", f"{highest:.2f} m")]
        if blank:
            warnings.append(f"{blank} blank views: every place looks alike to them; inspect the scans that they were drawn from")
        if empty > 0.97 * count:
            warnings.append(
                f"{100 * empty / count:.1f} % of the bins are empty: too fine a view for these scans; inspect the scans"
            )
    return Highlights((Section("", tuple(drive)),), tuple(warnings))


def _labels(artifact: Artifact) -> Highlights:
    places, oracle, nearest = (artifact.load(name) for name in ("places", "oracle", "nearest_m"))
    seen = places >= 0
    rows = [
        ("submaps", f"{len(places):,}"),
        ("places", f"{artifact['cells'].shape[0]:,} of training, {_distinct(places[seen]):,} met here"),
    ]
    warnings = []
    if len(places):
        rows.append(("seen", f"{int(seen.sum()):,} submaps ({100 * seen.mean():.1f} %), unseen {int((~seen).sum()):,}"))
        rows.append(
            ("nearest", f"training anchor: median {metres(float(np.median(nearest)))}, farthest {metres(float(nearest.max()))}")
        )
    if seen.any():
        rows.append(
            (
                "oracle",
                f"the nearest training anchor's place is the true one for {100 * (oracle == places)[seen].mean():.1f} % of the seen",
            )
        )
    elif len(places):
        warnings.append("no submap lies in a place of training: do both sequences share one world frame, and the grid's box?")
    return Highlights((Section("", tuple(rows)),), tuple(warnings))


def _rankings(artifact: Artifact) -> Highlights:
    places, costs, novelty = (artifact.load(name) for name in ("places", "costs", "novelty"))
    threshold = float(artifact.attrs["threshold"])
    rows = [("queries", f"{len(places):,}, {places.shape[1]} places each")]
    warnings = []
    if len(places):
        low, mid, high = np.percentile(novelty, (5, 50, 95))
        told = np.isfinite(artifact.load("heading_deg")).mean()
        rows += [
            ("novelty", f"5 % {low:.3g}, median {mid:.3g}, 95 % {high:.3g}"),
            ("rejected", f"{100 * (novelty >= threshold).mean():.1f} % at the threshold {threshold:.4g}"),
            ("first answers", f"{_distinct(places[:, 0]):,} distinct places"),
            ("heading", f"told for {100 * told:.3g} % of the queries"),
        ]
        if (np.diff(costs, axis=1) < 0).any():
            warnings.append("costs do not rise along the ranks: the method ranked wrongly, and its recall means nothing")
        if len(places) > 1 and _distinct(places[:, 0]) == 1:
            warnings.append("every query gets the same first answer: the model learned nothing, or the views are blank")
    return Highlights((Section("", tuple(rows)),), tuple(warnings))


def _evaluations(artifact: Artifact) -> Highlights:
    auc, seen, rank, outcome = (artifact.load(name) for name in ("auc", "seen", "true_rank", "outcome"))
    error = artifact.load("error_m")
    rows = [("queries", f"{len(seen):,}, {int(seen.sum()):,} seen and {int((~seen).sum()):,} unseen")]
    tops = [n for n in (1, 5, 25) if n <= len(auc)]
    rows.append(("AUC", ", ".join(f"top {n} {auc[n - 1]:.3f}" for n in tops)))
    if seen.any():
        rows.append(
            (
                "recall",
                ", ".join(f"top {n} {((rank >= 0) & (rank < n))[seen].mean():.3f}" for n in tops) + " of the seen, none rejected",
            )
        )
        rows.append(("error", f"median {metres(float(np.nanmedian(error[seen])))} of the seen queries' first answers"))
    names = ("hits", "misses", "false alarms", "correct rejections")
    counts = ", ".join(f"{int((outcome == code).sum()):,} {name}" for code, name in enumerate(names))
    rows.append(("outcome", f"{counts} at the threshold {float(artifact.attrs['threshold']):.4g}"))
    rows.append(
        ("trained", f"on {artifact.attrs['train']}, tested on {artifact.attrs['sequence']}, {artifact.attrs['days']} days later")
    )
    warnings = () if seen.any() or not len(seen) else ("no query was seen in training: recall and AUC mean nothing here",)
    return Highlights((Section("", tuple(rows)),), warnings)


def _drive(artifact: Artifact, poses: str, what: str) -> tuple[list[tuple[str, str]], list[str]]:
    """Date, duration, path and step of a drive."""
    stamps, xyz = artifact.load("stamps_ns"), np.asarray(artifact[poses][:, :3, 3])
    rows = [(what, f"{len(stamps):,}")]
    if not len(stamps):
        return rows, []
    known = np.isfinite(xyz).all(axis=1)
    steps = np.linalg.norm(np.diff(xyz[known], axis=0), axis=1)
    seconds = float(stamps[-1] - stamps[0]) * 1e-9
    rows += [("date", moment(int(stamps[0]))), ("duration", duration(seconds))]
    warnings = []
    if len(steps):
        rows.append(
            (
                "path",
                f"{metres(float(steps.sum()))}, step median {metres(float(np.median(steps)))}, longest {metres(float(steps.max()))}",
            )
        )
        low, high = xyz[known].min(axis=0), xyz[known].max(axis=0)
        box = ", ".join(f"{axis} {a:.0f} … {b:.0f} m" for axis, a, b in zip("xyz", low, high, strict=True))
        rows.append(("world", f"{box} (z up)".replace("-", "−")))
    if not known.all():
        warnings.append(f"{int((~known).sum())} {what} have no pose (NaN): `dvc repro` them")
    if (np.diff(stamps) <= 0).any():
        warnings.append("stamps do not increase: two logs mixed, or a clock set back; `dvc repro` the scans")
    return rows, warnings


def _distinct(values: NDArray[Any]) -> int:
    return len(np.unique(values))


KINDS: dict[str, Callable[[Artifact], Highlights]] = {
    "scans": _scans,
    "submaps": _submaps,
    "views": _views,
    "labels": _labels,
    "rankings": _rankings,
    "evaluations": _evaluations,
}
