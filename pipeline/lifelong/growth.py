"""Growth of a site: the scans that it adopts of a later day in; the parts of the grown site out.

`planned` says what would be learned, `grown` learns it: the site's method learns the scans' views,
and in its map scans replace the submaps that they contradict.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.core.building import build
from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.lifelong.adoption import Adoption, NothingAdoptedError
from pipeline.matching.places import Places
from pipeline.matching.ranking import Rows, TrainingSet
from pipeline.matching.rejection import HELD_OUT
from pipeline.online.pack import learned_from
from pipeline.online.site import ROOTS, Site
from pipeline.online.site_file import Arrays, Parts
from pipeline.online.site_json import Growth as SiteGrowth
from pipeline.online.site_json import LearnedDay, SiteDescription
from pipeline.posing.changes import contradicted, usual_contradiction
from pipeline.posing.targets import thinned


@dataclass(frozen=True)
class Growth:
    """What a site would learn of a day: a plan, before anything is learned."""

    adoption: Adoption
    places: Places
    scan_places: NDArray[np.int64]
    """(scan,) the place of each; −1 outside all places of the site."""
    changed: dict[int, int]
    """Submaps that are contradicted, each with the scan that takes its place."""
    added: NDArray[np.int64]
    """Scans of new places, which the map gets too."""

    @property
    def used(self) -> NDArray[np.int64]:
        """The scans that lie in a place of the site."""
        return np.flatnonzero(self.scan_places >= 0)

    def line(self, site: Site) -> str:
        """Describe the plan in a line."""
        adoption = self.adoption
        place_count = len(site.places.cells)
        way = "surveyed" if adoption.surveyed else "adopted"
        wrong = (
            f", {adoption.wrong.sum()} of them wrong by the log's own poses"
            if adoption.wrong.any()
            else ""
        )
        places = f"{len(self.places.cells) - place_count} new places beside {place_count}"
        return (
            f"{len(self.used)} of {adoption.scan_count} scans {way}{wrong}; {places}; "
            f"{len(self.changed)} submaps have changed"
        )


def planned(site: Site, adoption: Adoption) -> Growth:
    """Plan what the site can learn of the day's scans.

    Raises NothingAdoptedError where none lies in a place.
    """
    xy_m = adoption.world_T_scan[:, :2, 3]
    places = site.places.grown(xy_m) if adoption.surveyed else site.places
    scan_places = places.at(xy_m)
    walls = site.fixer.walls
    if (scan_places < 0).all():
        raise NothingAdoptedError(
            f"nothing to learn of {adoption.scan_count} scans: those adopted lie in no place of "
            "the site"
        )
    usual_share = usual_contradiction(site.targets, walls)
    changed = contradicted(site.targets, walls, adoption.points, adoption.world_T_scan, usual_share)
    return Growth(
        adoption,
        places,
        scan_places,
        changed,
        np.flatnonzero(scan_places >= len(site.places.cells)),
    )


def grown(site: Site, parts: Parts, growth: Growth, name: str, progress: Progress) -> Parts:
    """The parts of a site after it learned the day `name`; `parts` are those before, with views."""
    description = parts.description
    earlier_growth = _growth(description)
    views = parts.views
    used_scans = growth.used
    learned = learned_views(site, parts)
    day_views = growth.adoption.views(site)
    new_views = TrainingSet(
        Rows(
            day_views.images[used_scans],
            day_views.stamps_ns[used_scans],
            day_views.world_T_anchor[used_scans],
        ),
        growth.scan_places[used_scans],
    )
    held_out = {key: array for key, array in views.items() if key.startswith(HELD_OUT)}
    method = build(description.method, ROOTS)
    model = method.grow({**parts.model, **held_out}, learned, new_views, progress)
    day_number = len(earlier_growth.days)
    growth_views = dict(learned_from(Rows.joined([learned.views, new_views.views]), model))
    growth_views["days"] = np.concatenate([views["days"], np.full(len(used_scans), day_number)])
    growth_views["chances"] = np.concatenate([views["chances"], growth.adoption.chance[used_scans]])
    new_places = len(growth.places.cells) - len(site.places.cells)
    day = LearnedDay(name, len(used_scans), new_places, len(growth.changed))
    return Parts(
        replace(
            description,
            places=growth.places.grid,
            growth=replace(earlier_growth, days=(*earlier_growth.days, day)),
        ),
        {key: array for key, array in model.items() if key in parts.model},
        {
            **grown_map(site, parts, growth),
            "cells": growth.places.cells,
            **site.fixer.expectations.arrays,
        },
        None,
        growth_views,
    )


def learned_views(site: Site, parts: Parts) -> TrainingSet:
    """The views that a site has learned, each with its place.

    `parts` are those that it was opened from.
    """
    views = Rows(*(parts.views[key] for key in ("images", "stamps_ns", "world_T_anchor")))
    return TrainingSet(views, site.places.at(views.world_T_anchor[:, :2, 3]))


def grown_map(site: Site, parts: Parts, growth: Growth) -> Arrays:
    """The map after growth.

    It lacks changed submaps, and has the scans that replace them or are of new places.
    """
    arrays = parts.arrays
    kept = np.setdiff1d(np.arange(len(arrays["world_T_anchor"])), list(growth.changed))
    added_scans = np.unique([*growth.changed.values(), *growth.added]).astype(np.int64)
    range_m = parts.description.map.range_m
    voxel_m = _growth(parts.description).voxel_m
    points = [arrays["points"][arrays["offsets"][row] : arrays["offsets"][row + 1]] for row in kept]
    points += [
        thinned(growth.adoption.points[scan], range_m, voxel_m).astype(arrays["points"].dtype)
        for scan in added_scans
    ]
    poses = [arrays["world_T_anchor"][kept], growth.adoption.world_T_scan[added_scans]]
    return {
        "points": np.concatenate(points),
        "offsets": np.cumsum([0, *map(len, points)]),
        "world_T_anchor": np.concatenate(poses),
    }


def _growth(description: SiteDescription) -> SiteGrowth:
    """What the site needs to grow; raises ConfigError for one that was exported."""
    if description.growth is None:
        raise ConfigError(
            f"{description.name}: an exported site cannot grow; grow the site that it came from"
        )
    return description.growth
