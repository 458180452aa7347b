"""The content of a site's site.json, as dataclasses that `site_file` fills and writes."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any, Self

from pipeline.core.datum import Datum
from pipeline.core.grid import Grid
from pipeline.level.fix import LevelFixer
from pipeline.posing.map_verdict import NOT_CALIBRATED
from pipeline.posing.verdict import Verdict

VERSION = 6
"""The version of site files that is written and read."""
Settings = Mapping[str, Any]
"""The settings of one object: its class as `_target_`, and the class's parameters, as
`pipeline.core.building.build` takes them."""


@dataclass(frozen=True)
class MapSettings:
    """How the points of the map are stored."""

    grain_m: float
    """The points are stored as whole multiples of this length."""
    range_m: float
    """The map has the points within this distance of their submap's anchor."""
    single: bool
    """Whether each submap is one scan."""
    is_tiled: bool = False
    """Whether it is a 3-D map in tiles (posing/cut_outs.py), of which no submaps are kept."""
    voxel_m: float | None = None
    """The side of the voxels of a map in tiles."""


@dataclass(frozen=True)
class Sensor:
    """A description of the training scans.

    All numbers but `lift_m` are medians over scans, None if most scans have no value.
    """

    lift_m: float
    """How far the data set's reader raises the points."""
    points: float | None
    """The number of points in a scan."""
    azimuth_deg: float | None
    """The degrees around the sensor that have points."""
    beams: float | None
    """The number of beams."""
    ground_m: float | None
    """The z of the ground."""
    sensor_m: float | None
    """The height of the sensor over the ground."""
    warnings: tuple[str, ...]
    """The kinds of warnings on the training scans (pipeline.inspection.symptoms)."""


@dataclass(frozen=True)
class Provenance:
    """The origin of a site: its training sequence, artifacts and packages."""

    train: str
    """The training sequence, or the file of a map."""
    md5: Mapping[str, str | None]
    """DVC's digest of each artifact; None if it is unknown."""
    versions: Mapping[str, str]
    """The version of each package."""
    calibrated_on: str | None = None
    """The drive that the verdict of a 3-D map was learned from; None if the verdict is the usual
    one, and for a site that learned a drive."""

    @classmethod
    def of(cls, train: str, md5: Mapping[str, str | None], packages: Sequence[str]) -> Self:
        """The provenance with the versions of Python, yearloc and these packages."""
        versions = {"yearloc": version("yearloc"), "python": platform.python_version()}
        versions |= {name: version(name).partition("+")[0] for name in packages}
        return cls(train, md5, versions)


@dataclass(frozen=True)
class LearnedDay:
    """A day that the site learned."""

    day: str
    views: int
    """How many scans were learned."""
    places: int | None = None
    """The number of new places; None on the first day."""
    changed: int | None = None
    """The number of changed submaps; None on the first day."""


@dataclass(frozen=True)
class Increments:
    """What a site needs for incremental learning."""

    voxel_m: float
    """The map has one point in each voxel with this side."""
    days: tuple[LearnedDay, ...]
    """The days learned so far."""


@dataclass(frozen=True)
class CalibratedDay:
    """A later day that taught when to accept the poses of a site that learned a drive."""

    day: str
    blocks: int
    """The number of its blocks: stretches of path that count once each."""
    target_precisions: tuple[float, ...]
    """The target precisions whose thresholds it taught."""
    has_covariances: bool = False
    """Whether it taught the model of covariances."""


@dataclass(frozen=True)
class SiteDescription:
    """The content of site.json."""

    name: str
    """The model that was packed: STUDY/GRID/MODEL."""
    simulated: bool
    """Whether its world is simulated."""
    method: Settings
    """The method that ranks places."""
    view: Settings
    """The view that the method uses."""
    fixer: Settings
    """The search for poses (posing/search.py)."""
    k: int
    """How many places the method ranks."""
    places: Grid
    """The grid whose cells are the places."""
    map: MapSettings
    verdict: Verdict
    reader: Settings
    """The reader of the data set's logs."""
    sensor: Sensor
    provenance: Provenance
    incremental_learning: Increments | None = None
    """None for a site that cannot be updated."""
    calibrated_days: tuple[CalibratedDay, ...] = ()
    """The later days that thresholds were learned from, the latest last; empty for a 3-D map."""
    datum: Datum | None = None
    """Where its world lies on the Earth; None if nobody said so."""


@dataclass(frozen=True)
class LevelSettings:
    """The map's grid of a level site, and how sweeps are localised in it."""

    cell_m: float
    """The side of a cell."""
    origin: tuple[float, ...]
    """x, y in metres and yaw in radians of the outer corner of cell (0, 0)."""
    over_m: float
    """Sweeps are gathered over this length of path."""
    fixer: LevelFixer


@dataclass(frozen=True)
class LevelDescription:
    """The content of a level site's site.json."""

    name: str
    """The name of the map or the model, STUDY/GRID/MODEL, that was packed."""
    simulated: bool
    level: LevelSettings
    verdict: Verdict
    reader: Settings
    """The reader of the logs that are localised in it."""
    sensor: Sensor
    provenance: Provenance
    datum: Datum | None = None
    """Where its world lies on the Earth; None if nobody said so."""


def notes(description: SiteDescription | LevelDescription) -> tuple[str, ...]:
    """What is said of a site wherever its results are shown: it is simulated, or not calibrated."""
    words = ["simulated"] if description.simulated else []
    if usual := description.verdict.usual:
        at = "" if usual == description.verdict.reachable else f" at {', '.join(map(str, usual))}"
        words.append(f"{NOT_CALIBRATED}{at}")
    return tuple(words)
