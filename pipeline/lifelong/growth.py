"""Growth: adopted scans of a later day and a site go in, the grown site comes out (METHODS 11).

`planned` says what the site would learn; `grown` learns it:

- The site's method learns the views of the scans.
- In the map, a scan takes the place of each submap that scans contradict, and scans of new places
  are added.
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
    """A plan of what a site would learn of a day."""

    adoption: Adoption
    places: Places
    """The site's places after growth."""
    scan_places: NDArray[np.int64]
    """(scan,) the place of each adopted scan; −1 outside all places."""
    changed: dict[int, int]
    """For each submap that scans contradict, its number and that of the scan that replaces it."""
    added: NDArray[np.int64]
    """The numbers of the scans of new places, which are added to the map."""

    @property
    def used(self) -> NDArray[np.int64]:
        """The numbers of the adopted scans that lie in some place, which the method learns."""
        return np.flatnonzero(self.scan_places >= 0)

    def line(self, site: Site) -> str:
        """Describe the plan in a line."""
        adoption = self.adoption
        place_count = len(site.places.cells)
        way = "surveyed" if adoption.surveyed else "adopted"
        wrong = ""
        if adoption.wrong.any():
            wrong = f", {adoption.wrong.sum()} of them wrong by the log's own poses"
        places = f"{len(self.places.cells) - place_count} new places beside {place_count}"
        return (
            f"{len(self.used)} of {adoption.scan_count} scans {way}{wrong}; {places}; "
            f"{len(self.changed)} submaps have changed"
        )


def planned(site: Site, adoption: Adoption) -> Growth:
    """Plan what a site can learn of adopted scans. A survey may bring new places.

    Raises NothingAdoptedError where no scan lies in a place.
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
    of_new_places = np.flatnonzero(scan_places >= len(site.places.cells))
    return Growth(adoption, places, scan_places, changed, of_new_places)


def grown(site: Site, parts: Parts, growth: Growth, name: str, progress: Progress) -> Parts:
    """The parts of a site after it learned the day `name`, as `growth` plans it.

    `parts` are those that the site was opened from, with its views. Raises ConfigError for a site
    that cannot grow.
    """
    description = parts.description
    earlier_growth = _growth(description)
    views = parts.views
    used_scans = growth.used

    # the method learns the new views beside the earlier ones
    learned = learned_views(site, parts)
    used_views = growth.adoption.views(site).some(used_scans)
    new_views = TrainingSet(used_views, growth.scan_places[used_scans])
    held_out = {key: array for key, array in views.items() if key.startswith(HELD_OUT)}
    method = build(description.method, ROOTS)
    model = method.grow({**parts.model, **held_out}, learned, new_views, progress)

    # all views are kept for the next growth
    day_number = len(earlier_growth.days)
    growth_views = dict(learned_from(Rows.joined([learned.views, new_views.views]), model))
    growth_views["days"] = np.concatenate([views["days"], np.full(len(used_scans), day_number)])
    growth_views["chances"] = np.concatenate([views["chances"], growth.adoption.chance[used_scans]])

    new_places = len(growth.places.cells) - len(site.places.cells)
    day = LearnedDay(name, len(used_scans), new_places, len(growth.changed))
    grown_description = replace(
        description,
        places=growth.places.grid,
        growth=replace(earlier_growth, days=(*earlier_growth.days, day)),
    )
    grown_arrays = {
        **grown_map(site, parts, growth),
        "cells": growth.places.cells,
        **site.fixer.expectations.arrays,
    }
    grown_model = {key: array for key, array in model.items() if key in parts.model}
    return Parts(grown_description, grown_model, grown_arrays, None, growth_views)


def learned_views(site: Site, parts: Parts) -> TrainingSet:
    """The views that a site has learned, each with its place.

    `parts` are those that the site was opened from.
    """
    views = Rows(*(parts.views[key] for key in ("images", "stamps_ns", "world_T_anchor")))
    return TrainingSet(views, site.places.at(views.world_T_anchor[:, :2, 3]))


def grown_map(site: Site, parts: Parts, growth: Growth) -> Arrays:
    """The map after growth: without the changed submaps, and with the scans that replace them.

    Scans of new places are added too.
    """
    arrays = parts.arrays
    offsets = arrays["offsets"]
    submaps = np.setdiff1d(np.arange(len(arrays["world_T_anchor"])), list(growth.changed))
    added_scans = np.unique([*growth.changed.values(), *growth.added]).astype(np.int64)
    range_m = parts.description.map.range_m
    voxel_m = _growth(parts.description).voxel_m
    points = [arrays["points"][offsets[row] : offsets[row + 1]] for row in submaps]
    for scan in added_scans:
        scan_points = thinned(growth.adoption.points[scan], range_m, voxel_m)
        points.append(scan_points.astype(arrays["points"].dtype))
    poses = [arrays["world_T_anchor"][submaps], growth.adoption.world_T_scan[added_scans]]
    return {
        "points": np.concatenate(points),
        "offsets": np.cumsum([0, *map(len, points)]),
        "world_T_anchor": np.concatenate(poses),
    }


def _growth(description: SiteDescription) -> SiteGrowth:
    """What a site needs to grow. Raises ConfigError for an exported one, which lacks it."""
    if description.growth is None:
        raise ConfigError(
            f"{description.name}: an exported site cannot grow; grow the site that it came from"
        )
    return description.growth
