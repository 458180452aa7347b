"""What a site says of itself: its site.json as checked dataclasses."""

import math
from collections.abc import Mapping
from dataclasses import MISSING, asdict, dataclass, fields, is_dataclass
from types import UnionType
from typing import Any, Self, get_args, get_origin, get_type_hints

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.grid import Grid
from pipeline.level.fix import LevelFixer
from pipeline.posing.chances import Chances

VERSION = 5
NAMES = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
Settings = Mapping[str, Any]
"""Of one object: its `_target_` and parameters, as `pipeline.core.building.build` takes them."""


@dataclass(frozen=True)
class MapSettings:
    """How the points of the map are kept."""

    grain_m: float
    """Metres per unit of points."""
    range_m: float
    """Points farther from their anchor are left out."""
    single: bool
    """Each submap is one scan."""


@dataclass(frozen=True)
class Promises:
    """The chances of beliefs in a fix, and from which doubt on they are rejected."""

    pose: Chances
    place: Chances
    promises: tuple[float, ...]
    """Precisions that a user may want."""
    promised: Mapping[str, tuple[float, ...]]
    """For each of BELIEFS: reject from this doubt on to keep each promise; none where it is not
    above 0."""
    held_out: int
    """Blocks of the training day by which they were found."""
    unseen_share: float
    """Share of queries that are expected where training never went."""

    @property
    def kept(self) -> tuple[float, ...]:
        """The precisions that can be promised of a pose."""
        limits = zip(self.promises, self.promised["fix"], strict=True)
        return tuple(promise for promise, reject_from in limits if reject_from > 0)


@dataclass(frozen=True)
class Sensor:
    """What the scans that the site learned look like: medians, None where most have no value."""

    lift_m: float
    """How high the data set's reader raises the points."""
    points: float | None
    """Of a scan."""
    azimuth_deg: float | None
    """Degrees with points."""
    beams: float | None
    ground_m: float | None
    """z of the ground."""
    sensor_m: float | None
    """Height over the ground."""
    warnings: tuple[str, ...]
    """Kinds of warning that its scans give (pipeline.inspection.symptoms)."""


@dataclass(frozen=True)
class Provenance:
    """What the site was made of."""

    train: str
    """The day that was learned."""
    md5: Mapping[str, str | None]
    """DVC's digest of each part; None where it is not known."""
    versions: Mapping[str, str]


@dataclass(frozen=True)
class LearnedDay:
    """A day that the site learned."""

    day: str
    views: int
    places: int | None = None
    """New places; None on the first day."""
    changed: int | None = None
    """Submaps that changed; None on the first day."""


@dataclass(frozen=True)
class Growth:
    """What a site that can grow needs."""

    voxel_m: float
    """The map has one point a voxel."""
    days: tuple[LearnedDay, ...]


@dataclass(frozen=True)
class SiteDescription:
    """The content of site.json."""

    name: str
    """What was packed: STUDY/GRID/MODEL."""
    simulated: bool
    """Whether its world is simulated."""
    method: Settings
    view: Settings
    fixer: Settings
    k: int
    """Places that the method ranks."""
    places: Grid
    """The grid whose cells are the places."""
    map: MapSettings
    verdict: Promises
    reader: Settings
    """Of the data set's logs."""
    sensor: Sensor
    provenance: Provenance
    growth: Growth | None = None
    """None for a site that cannot grow."""

    @classmethod
    def from_json(cls, content: Any) -> Self:
        """Check the content of a site.json of this version.

        Raises ConfigError that names the first key that is missing or has another type.
        """
        description: Self = _checked(cls, content, "")
        return description

    def as_json(self) -> dict[str, Any]:
        """The content of site.json, of which what is optional and None is left out."""
        content = asdict(self)
        if self.growth is None:
            del content["growth"]
        else:
            content["growth"]["days"] = [
                {key: value for key, value in day.items() if value is not None}
                for day in content["growth"]["days"]
            ]
        return {"version": VERSION, **content}


@dataclass(frozen=True)
class LevelSettings:
    """The grid of a level site, and how it is asked."""

    cell_m: float
    """Side of a cell."""
    origin: tuple[float, ...]
    """x, y in metres and yaw in radians of the outer corner of cell (0, 0)."""
    over_m: float
    """Sweeps are gathered over so many metres of path."""
    fixer: LevelFixer


@dataclass(frozen=True)
class LevelDescription:
    """The content of a level site's site.json."""

    name: str
    """What was packed: the name of a map, or STUDY/GRID/MODEL."""
    simulated: bool
    level: LevelSettings
    verdict: Promises
    reader: Settings
    """Of the logs that it is asked with."""
    sensor: Sensor
    provenance: Provenance

    @classmethod
    def from_json(cls, content: Any) -> Self:
        """Check the content of a level site's site.json, as SiteDescription does."""
        description: Self = _checked(cls, content, "")
        return description

    def as_json(self) -> dict[str, Any]:
        """The content of site.json."""
        return {"version": VERSION, **asdict(self)}


def _checked(hint: Any, value: Any, key: str) -> Any:
    """A value as its field is annotated; raises ConfigError where it is of another type."""
    origin = get_origin(hint)
    arguments = get_args(hint)
    if is_dataclass(hint) and isinstance(hint, type):
        values = _fields(hint, _of_type(Mapping, "a table", value, key), key)
        try:
            return hint(**values)
        except (ValueError, InputError) as error:  # a Grid checks its box
            raise ConfigError(f"{key}: {error}") from None
    if origin is UnionType:  # `X | None`
        return None if value is None else _checked(arguments[0], value, key)
    if origin is tuple:
        items = _of_type(list | tuple, "a list", value, key)
        return tuple(_checked(arguments[0], item, f"{key}[{i}]") for i, item in enumerate(items))
    if origin is Mapping:
        table = _of_type(Mapping, "a table", value, key)
        return {name: _checked(arguments[1], item, f"{key}.{name}") for name, item in table.items()}
    if hint is Any:
        return value
    expected = int | float if hint is float else hint
    if isinstance(value, bool) and hint is not bool:
        expected = type(None)
    number = _of_type(expected, NAMES[hint], value, key)
    if hint is float and not math.isfinite(number):
        raise ConfigError(f"{key}={value}: expected a number")
    return number


def _fields(cls: Any, table: Mapping[str, Any], key: str) -> dict[str, Any]:
    """The fields of a dataclass, from a table of their values."""
    hints = get_type_hints(cls)
    values = {}
    for field in fields(cls):
        path = f"{key}.{field.name}" if key else field.name
        if field.name in table:
            values[field.name] = _checked(hints[field.name], table[field.name], path)
        elif field.default is MISSING:
            raise ConfigError(f"has no {path}")
    return values


def _of_type(expected: Any, words: str, value: Any, key: str) -> Any:
    if not isinstance(value, expected):
        raise ConfigError(f"{key}={value}: expected {words}")
    return value
