"""Updates a site: a site and pseudo-labelled scans in, the updated site out (METHODS 11).

`planned` says what the site would learn; `updated` learns it:

- The site's method learns the views of the scans.
- In the map, a scan replaces each submap that scans contradict, and scans of new places are added.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.core.building import build
from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from pipeline.lifelong.map_update import MapUpdate, planned_map, updated_map_site
from pipeline.lifelong.pseudo_labels import NoPseudoLabelsError, PseudoLabels
from pipeline.matching.places import Places
from pipeline.matching.ranking import Rows, TrainingSet
from pipeline.matching.rejection import VALIDATION
from pipeline.online.pack import learned_from
from pipeline.online.site import ROOTS, Site, drawn_walls
from pipeline.online.site_file import Arrays, Parts
from pipeline.online.site_json import Increments, LearnedDay, SiteDescription
from pipeline.posing.changes import contradicted, usual_contradiction
from pipeline.posing.cut_outs import CutOuts
from pipeline.posing.targets import thinned


@dataclass(frozen=True)
class Update:
    """A plan of what a site would learn of a day."""

    pseudo_labels: PseudoLabels
    places: Places
    """The site's places after the update."""
    scan_places: NDArray[np.int64]
    """(scan,) the place of each pseudo-labelled scan; −1 outside all places."""
    changed: dict[int, int]
    """The number of each submap that scans contradict, to the number of the scan that replaces it.
    """
    added: NDArray[np.int64]
    """The numbers of the scans of new places, which are added to the map."""

    @property
    def used(self) -> NDArray[np.int64]:
        """The numbers of the pseudo-labelled scans that lie in a place; the method learns these."""
        return np.flatnonzero(self.scan_places >= 0)

    def line(self, site: Site) -> str:
        """Describe the plan in a line."""
        place_count = len(site.places.cells)
        places = f"{len(self.places.cells) - place_count} new places beside {place_count}"
        return (
            f"{self.pseudo_labels.words(len(self.used))}; {places}; "
            f"{len(self.changed)} submaps have changed"
        )


AnyUpdate = Update | MapUpdate
"""The update of a site whose method learned a drive, or of the site of a 3-D map."""


def planned(site: Site, pseudo_labels: PseudoLabels) -> AnyUpdate:
    """Plan what a site can learn from labelled scans. Only reference poses add new places.

    Raises NoPseudoLabelsError if no scan lies in a place, or if a 3-D map has all that they show.
    """
    if isinstance(site.targets, CutOuts):
        return planned_map(site, site.targets, pseudo_labels)
    return planned_submaps(site, pseudo_labels)


def planned_submaps(site: Site, pseudo_labels: PseudoLabels) -> Update:
    """Plan what a site that learned a drive can learn from labelled scans; raises as `planned`."""
    xy_m = pseudo_labels.world_T_scan[:, :2, 3]
    places = site.places.extended(xy_m) if pseudo_labels.has_reference_poses else site.places
    scan_places = places.at(xy_m)
    walls = site.fixer.walls
    if (scan_places < 0).all():
        raise NoPseudoLabelsError(
            f"nothing to learn of {pseudo_labels.scan_count} scans: those pseudo-labelled lie in "
            "no place of the site"
        )
    usual_share = usual_contradiction(site.targets, walls)
    changed = contradicted(
        site.targets, walls, pseudo_labels.points, pseudo_labels.world_T_scan, usual_share
    )
    of_new_places = np.flatnonzero(scan_places >= len(site.places.cells))
    return Update(pseudo_labels, places, scan_places, changed, of_new_places)


def updated(site: Site, parts: Parts, update: AnyUpdate, name: str, progress: Progress) -> Parts:
    """The parts of a site after it learned the day `name`, as `update` plans it.

    `parts` are the parts that the site was opened from, with its views. Raises ConfigError for a
    site that cannot be updated.
    """
    if isinstance(update, MapUpdate):
        assert isinstance(site.targets, CutOuts)
        return updated_map_site(site.targets, parts, update, name, progress)
    description = parts.description
    increments = _increments(description)
    views = parts.views
    used_scans = update.used

    # the method learns the new views beside the earlier ones
    learned = learned_views(site, parts)
    used_views = update.pseudo_labels.views(site).select(used_scans)
    new_views = TrainingSet(used_views, update.scan_places[used_scans])
    validation = {key: array for key, array in views.items() if key.startswith(VALIDATION)}
    method = build(description.method, ROOTS)
    model = method.extend({**parts.model, **validation}, learned, new_views, progress)

    # all views are kept for the next update
    day_number = len(increments.days)
    update_views = dict(learned_from(Rows.joined([learned.views, new_views.views]), model))
    update_views["days"] = np.concatenate([views["days"], np.full(len(used_scans), day_number)])
    update_views["probabilities"] = np.concatenate(
        [views["probabilities"], update.pseudo_labels.probability[used_scans]]
    )

    new_places = len(update.places.cells) - len(site.places.cells)
    day = LearnedDay(name, len(used_scans), new_places, len(update.changed))
    updated_description = replace(
        description,
        places=update.places.grid,
        incremental_learning=replace(increments, days=(*increments.days, day)),
    )
    updated_arrays = {
        **updated_map(site, parts, update),
        "cells": update.places.cells,
        **site.fixer.expectations.arrays,
    }
    updated_arrays |= drawn_walls(updated_description, updated_arrays)
    updated_model = {key: array for key, array in model.items() if key in parts.model}
    return Parts(updated_description, updated_model, updated_arrays, None, update_views)


def learned_views(site: Site, parts: Parts) -> TrainingSet:
    """The views that a site has learned, each with its place.

    `parts` are the parts that the site was opened from.
    """
    views = Rows(*(parts.views[key] for key in ("images", "stamps_ns", "world_T_anchor")))
    return TrainingSet(views, site.places.at(views.world_T_anchor[:, :2, 3]))


def updated_map(site: Site, parts: Parts, update: Update) -> Arrays:
    """The map after an update: changed submaps are replaced, and scans of new places are added."""
    arrays = parts.arrays
    offsets = arrays["offsets"]
    submaps = np.setdiff1d(np.arange(len(arrays["world_T_anchor"])), list(update.changed))
    added_scans = np.unique([*update.changed.values(), *update.added]).astype(np.int64)
    range_m = parts.description.map.range_m
    voxel_m = _increments(parts.description).voxel_m
    points = [arrays["points"][offsets[row] : offsets[row + 1]] for row in submaps]
    for scan in added_scans:
        scan_points = thinned(update.pseudo_labels.points[scan], range_m, voxel_m)
        points.append(scan_points.astype(arrays["points"].dtype))
    poses = [arrays["world_T_anchor"][submaps], update.pseudo_labels.world_T_scan[added_scans]]
    return {
        "points": np.concatenate(points),
        "offsets": np.cumsum([0, *map(len, points)]),
        "world_T_anchor": np.concatenate(poses),
    }


def _increments(description: SiteDescription) -> Increments:
    """What a site needs to learn; raises ConfigError for an exported site, which lacks it."""
    if description.incremental_learning is None:
        raise ConfigError(
            f"{description.name}: an exported site cannot be updated; update the site that it "
            "came from"
        )
    return description.incremental_learning
