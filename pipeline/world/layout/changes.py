"""What of a year shows by some day, as one could list it who knew the place: sites, buildings, trees."""

from collections.abc import Sequence
from math import ceil

import numpy as np
from numpy.typing import NDArray

from pipeline.formats.changes import Change, visible
from pipeline.world.layout.campus import Campus
from pipeline.world.layout.events import Event
from pipeline.world.layout.greenery import Plant
from pipeline.world.layout.site import FENCE_BEFORE_DAYS


def changes_by(day: int, campus: Campus, events: Sequence[Event], origin_m: NDArray[np.float64]) -> list[Change]:
    """What differs on `day` from the training day, in a frame in which the world's origin lies at `origin_m` (2,).

    A tree is listed on the day when it is felled, or planted; those that make room for a site are part of it.
    """
    cleared = {event.day - FENCE_BEFORE_DAYS for event in events if event.what == "construction"}
    happened: list[tuple[str, float, float, Event | Plant]]
    happened = [(event.what, event.from_day, event.day, event) for event in events]
    grown = [plant for plant in campus.plants if plant.trunk_m and plant.born_day < plant.dead_day]
    happened += [("tree", at, at, tree) for tree in grown for at in {tree.born_day, tree.dead_day} - cleared if 0 < at < np.inf]
    return visible(
        (
            Change(what, ceil(from_day), ceil(done_day), float(thing.x_m + origin_m[0]), float(thing.y_m + origin_m[1]))
            for what, from_day, done_day, thing in happened
        ),
        day,
    )
