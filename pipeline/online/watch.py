"""Records a localised drive for rerun's viewer, whose camera follows the robot (`yearloc watch`).

The recording shows each scan on the map in the colour of its verdict, the runner-up (the next best
pose elsewhere), and the verdict and probabilities over time. It includes the layout of the panels.
"""

from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import needed
from pipeline.core.frames import Poses
from pipeline.core.replacing import replace
from pipeline.online.inputs import Scan
from pipeline.online.site import Fix, Site

COLOURS = {
    "accepted": (86, 180, 233),
    "near": (0, 158, 115),
    "ambiguous": (230, 159, 0),
    "rejected": (213, 94, 0),
    "no pose": (120, 120, 120),
}
"""The colour of each verdict, from Okabe and Ito's palette for colour-blind readers."""
MAP_GREY = (150, 150, 150)
PATH_GREY = (90, 90, 90)
GROUND_TRUTH_YELLOW = (240, 228, 66)
MAP_POINTS = 400_000
"""About how many points of the map are shown."""
BEHIND_M = (-22.0, 0.0, 13.0)
AHEAD_M = (10.0, 0.0, 0.0)
"""The camera behind the robot and the point that it looks at, in the robot's frame."""
ABOVE_M = (-0.1, 0.0, 70.0)
"""The camera above the robot, in the robot's frame."""
ROBOT = "world/robot"
RUNNER_UP = "world/runner_up"
"""The paths of rerun's entities for the scan at its fix and at the runner-up."""


class Recording(ExitStack):
    """Writes a recording for rerun to FILE.rrd, whole or not at all.

    Without a file it opens rerun's viewer.
    """

    def __init__(self, site: Site, out: Path | None, target_precision: float | None) -> None:
        """Raises NotInstalledError if rerun is not installed."""
        with needed("watch", "490 MB"):
            import rerun
        super().__init__()
        self._rerun = rerun
        self._site = site
        self._fixes_m: dict[str, list[NDArray[np.float64]]] = {word: [] for word in COLOURS}
        self._origin_m = origin(site)
        self._title = site.title
        if self._origin_m.any():
            self._title += f", from x {self._origin_m[0]:.0f} m, y {self._origin_m[1]:.0f} m"
        self._least_probability = None
        if target_precision is not None:
            pose_threshold, *_ = site.target_precisions[target_precision]  # an error probability
            self._least_probability = 1 - pose_threshold
        self._stream = rerun.RecordingStream("yearloc")
        if out is None:
            self._stream.spawn(default_blueprint=self._blueprint(live=True))
        else:
            self._stream.save(
                self.enter_context(replace(out)),
                default_blueprint=self._blueprint(live=False),
            )
        self.callback(self._stream.disconnect)
        self.callback(self._stream.flush)
        self._log_static()

    def add(self, number: int, scan: Scan, points_m: NDArray[np.float64], fix: Fix) -> None:
        """Add a scan (n, 3) and its fix, at its number and its stamp on the timelines."""
        rerun = self._rerun
        stream = self._stream
        stream.set_time("scan", sequence=number)
        if scan.stamp_ns is not None:
            stream.set_time("time", timestamp=np.datetime64(scan.stamp_ns, "ns"))
        walls_m = self._site.walls_of(points_m)
        colour = COLOURS[fix.verdict]
        self._log_placed(ROBOT, walls_m, fix.world_T_sensor, colour)
        runner_up = fix.runners_up[0] if fix.runners_up else None
        runner_up_pose = np.full((4, 4), np.nan) if runner_up is None else runner_up.world_T_sensor
        self._log_placed(RUNNER_UP, walls_m, runner_up_pose, COLOURS["ambiguous"])
        if np.isfinite(fix.world_T_sensor).all():
            fixes_m = self._fixes_m[fix.verdict]
            fixes_m.append(fix.world_T_sensor[:3, 3] - self._origin_m)
            stream.log(
                f"world/fixes/{fix.verdict.replace(' ', '_')}",
                rerun.Points3D(fixes_m, colors=colour, radii=0.6),
            )
        if np.isfinite(scan.world_T_scan).all():
            ground_truth_m = scan.world_T_scan[:3, 3] - self._origin_m
            stream.log(
                "world/ground_truth",
                rerun.Points3D([ground_truth_m], colors=GROUND_TRUTH_YELLOW, radii=0.8),
            )
        stream.log("verdict", rerun.StateChange(state=fix.verdict))
        stream.log("probability/pose", rerun.Scalars(fix.probability))
        if runner_up is not None:
            stream.log("probability/runner_up", rerun.Scalars(runner_up.probability))
        if self._least_probability is not None:
            stream.log("probability/accepted_from", rerun.Scalars(self._least_probability))

    def _log_static(self) -> None:
        """Log what never changes: map, training path, names and colours of the curves."""
        rerun = self._rerun
        points_m = whole_map(self._site) - self._origin_m
        self._stream.log("world", rerun.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._stream.log(
            "world/map", rerun.Points3D(points_m, colors=MAP_GREY, radii=0.06), static=True
        )
        path_m = self._site.path_m
        if path_m is not None:
            self._stream.log(
                "world/training",
                rerun.LineStrips3D([path_m - self._origin_m], colors=PATH_GREY, radii=0.15),
                static=True,
            )
        for path, colour, name in (
            ("probability/pose", COLOURS["accepted"], "probability of the pose"),
            ("probability/runner_up", COLOURS["ambiguous"], "probability of the runner-up"),
            ("probability/accepted_from", COLOURS["rejected"], "accepted from here"),
        ):
            self._stream.log(path, rerun.SeriesLines(colors=colour, names=name), static=True)
        self._stream.log(
            "verdict",
            rerun.StateConfiguration(values=[*COLOURS], colors=[*COLOURS.values()]),
            static=True,
        )

    def _log_placed(
        self,
        path: str,
        points_m: NDArray[np.float64],
        world_T_scan: Poses,
        colour: tuple[int, int, int],
    ) -> None:
        """Log a scan's points (n, 3) at a pose (4, 4); without a pose the camera does not move."""
        rerun = self._rerun
        if not np.isfinite(world_T_scan).all():
            self._stream.log(f"{path}/scan", rerun.Clear(recursive=False))
            return
        self._stream.log(
            path,
            rerun.Transform3D(
                translation=world_T_scan[:3, 3] - self._origin_m, mat3x3=world_T_scan[:3, :3]
            ),
        )
        self._stream.log(f"{path}/scan", rerun.Points3D(points_m, colors=colour, radii=0.12))
        self._stream.log(
            f"{path}/heading",
            rerun.Arrows3D(vectors=[(6, 0, 0)], origins=[(0, 0, 0.5)], colors=colour, radii=0.5),
        )

    def _blueprint(self, live: bool) -> Any:
        """The layout of the panels."""
        from rerun import blueprint

        all_but_runner_up = ["/world/**", f"- /{RUNNER_UP}/**"]
        drive = blueprint.Spatial3DView(
            origin=ROBOT,
            contents=all_but_runner_up,
            name=self._title,
            eye_controls=blueprint.EyeControls3D(
                position=BEHIND_M, look_target=AHEAD_M, eye_up=(0, 0, 1)
            ),
            line_grid=False,
        )
        from_above = blueprint.EyeControls3D(
            position=ABOVE_M, look_target=(0, 0, 0), eye_up=(1, 0, 0)
        )
        scan_on_map = blueprint.Spatial3DView(
            origin=ROBOT,
            contents=["/world/map", "/world/training", f"/{ROBOT}/**"],
            name="the scan on the map, from above",
            eye_controls=from_above,
            line_grid=False,
        )
        runner_up = blueprint.Spatial3DView(
            origin=RUNNER_UP,
            contents=["/world/map", "/world/training", f"/{RUNNER_UP}/**"],
            name="the runner-up: the next best pose elsewhere",
            eye_controls=from_above,
            line_grid=False,
        )
        over_time = blueprint.Vertical(
            blueprint.StateTimelineView(origin="verdict", name="verdict"),
            blueprint.TimeSeriesView(origin="probability", name="probability of being right"),
            row_shares=[2, 3],
        )
        return blueprint.Blueprint(
            blueprint.Horizontal(
                blueprint.Vertical(drive, over_time, row_shares=[2, 1]),
                blueprint.Vertical(scan_on_map, runner_up),
                column_shares=[3, 2],
            ),
            blueprint.TimePanel(
                timeline="scan",
                state="collapsed",
                play_state="following" if live else "playing",
                fps=10.0,
            ),
            collapse_panels=True,
        )


def origin(site: Site) -> NDArray[np.float64]:
    """The centre of the site (3,): x and y in whole metres, and 0.

    It is subtracted for viewers, whose float32 is off by decimetres for coordinates as large as
    UTM's.
    """
    places_m = site.walls_m if site.path_m is None else site.path_m
    return np.append(np.rint(places_m[:, :2].mean(axis=0)), 0.0)


def whole_map(site: Site) -> NDArray[np.float64]:
    """The points (n, 3) of all walls of the map, in metres in the world, thinned to MAP_POINTS."""
    points_m = site.walls_m
    return points_m[:: max(1, len(points_m) // MAP_POINTS)]
