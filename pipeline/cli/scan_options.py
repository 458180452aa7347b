"""The options that say how scans are read, of `localize`, `watch`, `grow` and `failures`."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.cli.options import lidar_of
from pipeline.core.errors import ConfigError

if TYPE_CHECKING:
    from collections.abc import Mapping

    from pipeline.cli.summary import Summary
    from pipeline.core.frames import Poses
    from pipeline.online.inputs import Scan
    from pipeline.online.site import Site


@dataclass(frozen=True)
class ScanOptions:
    """How scans are read for a site: what the site says, and what the command line says."""

    reader: "Mapping[str, Any]"
    """The site's reader: logs that it opens have poses."""
    lift_m: float
    """Raises the points of files and bags, so that the ground is at z = 0."""
    topic: str | None
    """Of a bag with several clouds."""
    odometry: str | None
    """Of a bag: a topic of poses, or tf:PARENT>CHILD."""
    body_T_lidar: "Poses | None"
    """(4, 4) places the points, in place of `lift_m` and a bag's transforms."""
    is_level: bool
    """Whether a bag's sweeps are read, not its clouds."""

    @classmethod
    def of(
        cls,
        site: "Site",
        topic: str | None = None,
        odometry: str | None = None,
        body_T_lidar: str | None = None,
        lift_m: float | None = None,
    ) -> "ScanOptions":
        """The options for a site.

        Raises ConfigError for a `body_T_lidar` that is no x,y,z,roll,pitch,yaw.
        """
        return cls(
            site.description.reader,
            site.description.sensor.lift_m if lift_m is None else lift_m,
            topic,
            odometry,
            lidar_of(body_T_lidar),
            site.is_level,
        )

    def scans(self, path: str, skipped: Counter[str]) -> "Iterator[Scan]":
        """The scans of a file, folder, log or bag; those left out are counted in `skipped`."""
        from pipeline.online.inputs import scans

        return scans(
            path,
            self.reader,
            self.lift_m,
            self.topic,
            self.odometry,
            skipped,
            self.body_T_lidar,
            self.is_level,
        )

    def followed_scans(self, path: str, idle_s: float, summary: "Summary") -> "Iterator[Scan]":
        """The scans of an .mcap that is still being recorded, until `idle_s` pass without a byte.

        What was lost on the way is added to the summary at the end.
        """
        from pipeline.online.follow import Following

        recording = Following(
            Path(path), self.topic, self.lift_m, idle_s, self.odometry, self.body_T_lidar
        )
        yield from recording.scans()
        summary.dropped += recording.dropped
        summary.skipped += recording.skipped
        if recording.damage:
            summary.broken.append(recording.damage)


def check_site(
    site: "Site", promise: float | None, odometry: str | None, track: bool, follow: bool
) -> None:
    """Raise ConfigError for options of `localize` and `watch` that the site has no use for."""
    site.check(promise)
    if odometry and not track and not site.is_level:
        raise ConfigError(f"--odometry {odometry}: needs --track")
    if site.is_level and follow:
        raise ConfigError("--follow: follows 3-D scans, and the site is level")
