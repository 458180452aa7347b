"""Records a localised drive for rerun's viewer.

It shows the map, each scan where it was placed, the likeliest places, novelty and verdict.
"""

from collections.abc import Iterable
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import ConfigError
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix, Site
from pipeline.replacing import replace

COLOURS = {
    "accepted": (46, 125, 50),
    "near": (30, 110, 200),
    "ambiguous": (240, 150, 30),
    "rejected": (198, 40, 40),
    "no pose": (120, 120, 120),
}
MAP_GREY = (150, 150, 150)
TRUTH = (240, 200, 60)
SNAPPED = (90, 170, 255)
MAP_POINTS = 400_000
LIKELIEST = 5
WALL_M = 0.3
"""Map points below this are ground, which hides the walls."""


class Recording:
    """Writes a recording for rerun to FILE.rrd, whole or not at all.

    Without a file it opens rerun's viewer.
    """

    def __init__(self, site: Site, out: Path | None, promise: float | None) -> None:
        """Raises ConfigError where rerun is not installed."""
        try:
            import rerun
        except ImportError:
            raise ConfigError(
                "rerun: not installed; `pip install 'yearloc[watch]'` (490 MB)"
            ) from None
        self._rerun = rerun
        self._site = site
        self._paths = dict[str, list[NDArray[np.float64]]]()
        self._origin_m = origin(site)
        self._title = f"{site.name}{', simulated' if site.description.simulated else ''}"
        if self._origin_m.any():
            self._title += f", from x {self._origin_m[0]:.0f} m, y {self._origin_m[1]:.0f} m"
        self._file = ExitStack()
        self._stream = rerun.RecordingStream(f"yearloc {site.name}")
        if out is None:
            self._stream.spawn(default_blueprint=self._blueprint())
        else:
            self._stream.save(
                self._file.enter_context(replace(out)), default_blueprint=self._blueprint()
            )
        points_m = whole_map(site) - self._origin_m
        self._stream.log(
            "world/map", rerun.Points3D(points_m, colors=MAP_GREY, radii=0.08), static=True
        )
        anchors_m = site.targets.world_T_anchor[:, :3, 3] - self._origin_m
        self._stream.log(
            "world/training", rerun.LineStrips3D([anchors_m], colors=TRUTH, radii=0.15), static=True
        )
        self._limit = None if promise is None else site.promises[promise]
        for path, colour, name in (
            ("novelty/scan", SNAPPED, "novelty"),
            ("novelty/threshold", (198, 40, 40), "threshold"),
        ):
            self._stream.log(path, rerun.SeriesLines(colors=colour, names=name), static=True)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stream.flush()
        self._stream.disconnect()
        self._file.__exit__(kind, error, trace)

    def add(self, number: int, scan: Scan, points_m: NDArray[np.float64], fix: Fix) -> None:
        """Add a scan and its fix, at its stamp or its number on the timeline."""
        rerun = self._rerun
        stream = self._stream
        stream.set_time("scan", sequence=number)
        if scan.stamp_ns is not None:
            stream.set_time("time", timestamp=np.datetime64(scan.stamp_ns, "ns"))
        colour = COLOURS[fix.verdict]
        placed = np.isfinite(fix.world_T_sensor).all()
        if placed:
            position_m = fix.world_T_sensor[:3, 3] - self._origin_m
            seen_m = points_m @ fix.world_T_sensor[:3, :3].T + position_m
            stream.log(
                "world/scan",
                rerun.Points3D(seen_m[points_m[:, 2] > WALL_M], colors=SNAPPED, radii=0.2),
            )
            heading = fix.world_T_sensor[:3, 0] * 6
            stream.log(
                "world/robot",
                rerun.Arrows3D(vectors=[heading], origins=[position_m], colors=colour, radii=0.5),
            )
            self._paths.setdefault(fix.verdict, []).append(position_m)
            stream.log(
                f"world/{fix.verdict}",
                rerun.Points3D(self._paths[fix.verdict], colors=colour, radii=0.8),
            )
        else:
            stream.log("world/scan", rerun.Clear(recursive=False))
        if np.isfinite(scan.world_T_scan).all():
            stream.log(
                "world/truth",
                rerun.Points3D(
                    [scan.world_T_scan[:3, 3] - self._origin_m], colors=TRUTH, radii=1.2
                ),
            )
        ranking = self._site.rank(points_m)
        chances = np.nan_to_num(
            1 - ranking.costs[0, :LIKELIEST].astype(np.float64), posinf=0, neginf=0
        )
        stream.log("places", rerun.BarChart(chances))
        stream.log("novelty/scan", rerun.Scalars(fix.novelty))
        if self._limit is not None:
            stream.log("novelty/threshold", rerun.Scalars(self._limit))
        stream.log(
            "verdict",
            rerun.TextLog(
                f"{fix.verdict}: place {fix.place}, overlap {fix.overlap:.2f}", level=_level(fix)
            ),
        )

    def _blueprint(self) -> Any:
        from rerun import blueprint

        side = blueprint.Vertical(
            blueprint.TimeSeriesView(origin="novelty", name="novelty against its threshold"),
            blueprint.BarChartView(origin="places", name="the five likeliest places"),
            blueprint.TextLogView(origin="verdict", name="verdicts"),
        )
        return blueprint.Blueprint(
            blueprint.Horizontal(
                blueprint.Spatial3DView(origin="world", name=self._title),
                side,
                column_shares=[3, 1],
            ),
            blueprint.TimePanel(timeline="scan"),
            collapse_panels=True,
        )


def origin(site: Site) -> NDArray[np.float64]:
    """The middle of the site, x and y in whole metres and 0 (3,), to subtract before drawing.

    Viewers use float32, in which coordinates as large as UTM's are off by decimetres.
    """
    middle_m = np.rint(site.targets.world_T_anchor[:, :2, 3].mean(axis=0))
    return np.append(middle_m, 0.0)


def whole_map(site: Site) -> NDArray[np.float64]:
    """Walls (n, 3) of the map in the world, thinned to MAP_POINTS."""
    parts: Iterable[NDArray[np.float64]] = (
        _walls(site.targets.points_m(row)) @ pose[:3, :3].T + pose[:3, 3]
        for row, pose in enumerate(site.targets.world_T_anchor)
    )
    points_m = np.concatenate(list(parts))
    return points_m[:: max(1, len(points_m) // MAP_POINTS)]


def _walls(points_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return points_m[points_m[:, 2] > WALL_M]


def _level(fix: Fix) -> str:
    return {"accepted": "INFO", "rejected": "WARN"}.get(fix.verdict, "DEBUG")
