"""Rows of buildings that repeat: a world built so that its places look alike.

Along both sides of every street stands one long building of equal units, as far from the street as
any other. There are two kinds (`OF_LINING`): `terraces` are rows of equal terraced houses, and a
`colonnade` is a campus of equal halls behind equal pillars. A place looks like the one a unit
farther on, and like its counterpart in another street: perceptual aliases.

Nothing here was set by the score of a method.
"""

from dataclasses import dataclass

from worlds.layout.buildings import Template
from worlds.layout.campus import Campus
from worlds.layout.lining import Lining, Side
from worlds.layout.structures import Part, Structure

FROM_CORNER_M = 18.0
"""How far from its ends a street has buildings: rows of two streets do not meet."""
FEWEST_UNITS = 4
"""A side of a street with less room than for these has no building."""
USUAL_UNITS = 10
"""Number of units of a building that is built in the course of the year."""
TREES_PER_BLOCK = 2
"""Number of trees that are tried in a block, behind the rows."""


@dataclass(frozen=True)
class Row:
    """What the buildings of a world are made of."""

    unit_m: float
    """Length of a unit along the street: a house, or the distance between two pillars."""
    depth_m: float
    """Depth of the buildings."""
    top_m: float
    """Height of their walls."""
    from_street_m: float
    """Distance between the border of the street and the walls."""
    fore: Template
    """The parts before and on each unit: y is 0 at the front wall and points away from the street,
    x is 0 in the middle of the unit."""
    roof_m: float
    """Height of the roof above the walls; it is half as deep as they are."""

    def body(self, units: int) -> Template:
        """The walls and the roof of a building of so many units, about its centre."""
        half_length_m = units * self.unit_m / 2
        half_depth_m = self.depth_m / 2
        ridge_m = self.top_m + self.roof_m
        return (
            Part(0, 0, half_length_m, half_depth_m, 0, self.top_m),
            Part(0, 0, half_length_m, half_depth_m / 2, self.top_m - 0.1, ridge_m),
        )

    def front(self, units: int) -> Template:
        """The parts before and on all units of a building, unit by unit, about its centre."""
        return tuple(
            Part(
                ahead_m=part.ahead_m + (unit - (units - 1) / 2) * self.unit_m,
                left_m=part.left_m - self.depth_m / 2,
                half_length_m=part.half_length_m,
                half_width_m=part.half_width_m,
                bottom_m=part.bottom_m,
                top_m=part.top_m,
            )
            for unit in range(units)
            for part in self.fore
        )


TERRACES = Row(
    unit_m=6.0,
    depth_m=9.0,
    top_m=6.0,
    from_street_m=4.0,
    roof_m=2.4,
    fore=(
        Part(-1.4, -0.4, 1.1, 0.45, 0, 3.2),  # the bay window
        Part(1.6, -0.5, 0.9, 0.5, 0, 0.4),  # the step before the door
        Part(1.6, -0.5, 1.0, 0.6, 2.3, 2.5),  # the canopy above it
        Part(3.0, -0.1, 0.15, 0.15, 0, 6.2),  # the end of the wall between two houses
        Part(3.0, -2.0, 0.12, 1.8, 0, 1.1),  # the wall between their front gardens
        Part(3.0, 4.5, 0.4, 0.8, 8.0, 9.6),  # the chimney
    ),
)
COLONNADE = Row(
    unit_m=4.0,
    depth_m=15.0,
    top_m=11.4,
    from_street_m=8.0,
    roof_m=1.2,
    fore=(
        Part(0.0, -3.0, 0.35, 0.35, 0, 4.6),  # the pillar
        Part(0.0, -1.6, 2.0, 1.75, 4.6, 5.2),  # the roof between pillars and wall
        Part(0.0, -0.1, 0.6, 0.15, 0, 11.4),  # the pier between two windows
    ),
)
OF_LINING = {"terraces": TERRACES, "colonnade": COLONNADE}
"""What stands along the streets of a world with such a lining."""


def build_rows(campus: Campus, lining: Lining) -> None:
    """Build a row along both sides of every street, as long as there is room for whole units.

    Buildings of the year's events are of the same kind, with USUAL_UNITS units.
    """
    row = OF_LINING[lining]
    usual = row.body(USUAL_UNITS)
    campus.templates = [usual]
    campus.fronts = {usual: row.front(USUAL_UNITS)}
    for street in range(len(campus.streets.edges)):
        for sign in (-1, 1):
            _build_along(Side(campus, street, sign), row)


def _build_along(side: Side, row: Row) -> None:
    """The longest building that fits about the middle of this side of a street."""
    campus = side.campus
    x_m, y_m = side.at(side.length_m / 2, row.from_street_m + row.depth_m / 2)
    most_units = int((side.length_m - 2 * FROM_CORNER_M) / row.unit_m)
    for units in range(most_units, FEWEST_UNITS - 1, -1):
        building = Structure(x_m, y_m, side.yaw_rad, row.body(units))
        if campus.fits(building):
            campus.build(building)
            campus.fronts[building.parts] = row.front(units)
            return
