"""Reads scans for a site as the options of `localize`, `watch`, `grow` and `failures` say."""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pipeline.cli.options import lidar_of
from pipeline.core.errors import ConfigError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from collections.abc import Mapping

    from pipeline.cli.summary import Summary
    from pipeline.core.frames import Poses
    from pipeline.online.inputs import Scan
    from pipeline.online.site import Site


@dataclass(frozen=True)
class ScanOptions:
    """How scans are read for a site, by the site's description and the command line."""

    reader: "Mapping[str, Any]"
    """Settings of the reader of the site's data set, which opens logs with their poses."""
    lift_m: float
    """By how much the points of files and bags are raised, so that the ground is at z = 0."""
    topic: str | None
    """The topic of a bag to read, if the bag has clouds on several."""
    odometry: str | None
    """The odometry of a bag: a topic of poses, or tf:PARENT>CHILD."""
    body_T_lidar: "Poses | None"
    """The pose (4, 4) that places the points, instead of `lift_m` and a bag's transforms."""
    message: str
    """The kind of a bag's messages that are read: clouds, or of a level site sweeps."""

    @classmethod
    def of(
        cls,
        site: "Site",
        topic: str | None = None,
        odometry: str | None = None,
        body_T_lidar: str | None = None,
        lift_m: float | None = None,
    ) -> "ScanOptions":
        """The options for a site, by the values of the command line's options.

        Raises ConfigError for a `body_T_lidar` that is not of the form x,y,z,roll,pitch,yaw.
        """
        return cls(
            reader=site.description.reader,
            lift_m=site.description.sensor.lift_m if lift_m is None else lift_m,
            topic=topic,
            odometry=odometry,
            body_T_lidar=lidar_of(body_T_lidar),
            message=site.message,
        )

    def scans_or_followed(
        self, path: str, follow: bool, idle_s: float, summary: "Summary"
    ) -> "Iterator[Scan]":
        """The scans of a finished input, or with `follow` those of a recording under way.

        A recording ends when `idle_s` pass without a byte. Scans that are left out or dropped are
        counted in the summary.
        """
        if not follow:
            yield from self.scans(path, summary.skipped)
            return
        from pipeline.online.follow import Following

        recording = Following(
            Path(path),
            topic=self.topic,
            lift_m=self.lift_m,
            idle_s=idle_s,
            odometry=self.odometry,
            body_T_lidar=self.body_T_lidar,
        )
        yield from recording.scans()
        summary.dropped += recording.dropped
        summary.skipped += recording.skipped
        if recording.damage:
            summary.broken.append(recording.damage)

    def scans(self, path: str, skipped: Counter[str]) -> "Iterator[Scan]":
        """The scans of a file, folder, log or bag.

        Scans that are left out are counted in `skipped`, by reason.
        """
        from pipeline.online.inputs import scans

        return scans(
            path,
            self.reader,
            self.lift_m,
            topic=self.topic,
            odometry=self.odometry,
            skipped=skipped,
            body_T_lidar=self.body_T_lidar,
            message=self.message,
        )


def check_site(
    site: "Site", promise: float | None, odometry: str | None, track: bool, follow: bool
) -> None:
    """Raise ConfigError for options of `localize` and `watch` that this site cannot heed."""
    site.check(promise)
    if odometry and not track and not site.gathers:
        raise ConfigError(f"--odometry {odometry}: needs --track")
    if site.is_level and follow:
        raise ConfigError("--follow: follows 3-D scans, and the site is level")
