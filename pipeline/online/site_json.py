"""The content of a site's site.json, as dataclasses.

`SiteDescription.from_json` and `LevelDescription.from_json` check a parsed file against the types
of their fields; `as_json` is the way back.
"""

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
"""The version of site files that is written, and read."""
NAMES = {float: "a number", int: "a whole number", str: "a text", bool: "true or false"}
"""The names of types in error messages."""
Settings = Mapping[str, Any]
"""The settings of one object: its `_target_`, a class, and the parameters of that, as
`pipeline.core.building.build` takes them."""


@dataclass(frozen=True)
class MapSettings:
    """How the points of the map are kept."""

    grain_m: float
    """The points are whole numbers of this many metres."""
    range_m: float
    """The map has the points within this distance of their submap's anchor."""
    single: bool
    """Whether each submap is one scan."""


@dataclass(frozen=True)
class Promises:
    """The verdict of a site: chances of beliefs in a fix, and limits of the doubt in each.

    The beliefs are BELIEFS of posing/verdict.py; the doubt is one minus the chance.
    """

    pose: Chances
    """Gives the chance that a pose is right."""
    place: Chances
    """Gives the chance that the robot is near a pose."""
    promises: tuple[float, ...]
    """The precisions that were tried; those `kept` a user may ask for."""
    promised: Mapping[str, tuple[float, ...]]
    """For each of BELIEFS and each promise, the doubt from which on to reject to keep the promise.
    Where it is not above 0 the promise cannot be kept."""
    held_out: int
    """The number of held-out blocks of the training day that the limits rest on."""
    unseen_share: float
    """The share of queries that are expected where training never went."""

    @property
    def kept(self) -> tuple[float, ...]:
        """The precisions that can be promised of a pose."""
        limits = zip(self.promises, self.promised["fix"], strict=True)
        return tuple(promise for promise, reject_from in limits if reject_from > 0)


@dataclass(frozen=True)
class Sensor:
    """What the scans that the site learned look like.

    All but `lift_m` are medians over scans, None where most scans have no value.
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
    """The kinds of warning that the scans give themselves (pipeline.inspection.symptoms)."""


@dataclass(frozen=True)
class Provenance:
    """What the site was made of."""

    train: str
    """The sequence that was learned, or the file of a map."""
    md5: Mapping[str, str | None]
    """DVC's digest of each artifact; None if it is unknown."""
    versions: Mapping[str, str]
    """The version of each package."""


@dataclass(frozen=True)
class LearnedDay:
    """A day that the site learned."""

    day: str
    views: int
    """How many scans were learned."""
    places: int | None = None
    """How many new places it brought; None on the first day."""
    changed: int | None = None
    """How many submaps had changed; None on the first day."""


@dataclass(frozen=True)
class Growth:
    """What a site needs in order to grow."""

    voxel_m: float
    """The map has one point in each voxel of this side."""
    days: tuple[LearnedDay, ...]
    """The days learned so far."""


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
    """The view that the method looks at."""
    fixer: Settings
    """The search for poses (posing/search.py)."""
    k: int
    """How many places the method ranks."""
    places: Grid
    """The grid whose cells are the places."""
    map: MapSettings
    verdict: Promises
    reader: Settings
    """The reader of the data set's logs."""
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
        """The content of site.json, without the optional keys that are None."""
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
    """The map's grid of a level site, and how sweeps are localised in it."""

    cell_m: float
    """The side of a cell."""
    origin: tuple[float, ...]
    """x, y in metres and yaw in radians of the outer corner of cell (0, 0)."""
    over_m: float
    """Sweeps are gathered over so much path."""
    fixer: LevelFixer


@dataclass(frozen=True)
class LevelDescription:
    """The content of a level site's site.json."""

    name: str
    """The name of the map or the model, STUDY/GRID/MODEL, that was packed."""
    simulated: bool
    level: LevelSettings
    verdict: Promises
    reader: Settings
    """The reader of the logs that are localised in it."""
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
    """A value of a field with the annotation `hint`; `key` is its path in site.json.

    Tables become dataclasses, lists tuples. Raises ConfigError for a value of another type.
    """
    origin = get_origin(hint)
    arguments = get_args(hint)
    if is_dataclass(hint) and isinstance(hint, type):
        values = _fields(hint, _of_type(Mapping, "a table", value, key), key)
        try:
            return hint(**values)
        except (ValueError, InputError) as error:  # a Grid checks its box
            raise ConfigError(f"{key}: {error}") from None
    if origin is UnionType:  # X | None
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
        expected = type(None)  # to Python a bool is an int: this one is refused
    number = _of_type(expected, NAMES[hint], value, key)
    if hint is float and not math.isfinite(number):
        raise ConfigError(f"{key}={value}: expected a number")
    return number


def _fields(cls: Any, table: Mapping[str, Any], key: str) -> dict[str, Any]:
    """The checked values of a dataclass's fields, from a table at the path `key`."""
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
    """The value; raises ConfigError, which expects `words`, if it is of another type."""
    if not isinstance(value, expected):
        raise ConfigError(f"{key}={value}: expected {words}")
    return value
