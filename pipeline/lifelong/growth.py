"""Growth of a site: a later day's scans become views that its method learns, and replace what they
contradict in its map."""

from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.lifelong.adoption import Adoption, NothingAdoptedError
from pipeline.matching.places import Places
from pipeline.matching.ranking import Rows, TrainingSet
from pipeline.matching.rejection import PREFIX as HELD_OUT
from pipeline.online.pack import day, learned_from
from pipeline.online.site import ROOTS, Site
from pipeline.online.site_file import Arrays, Parts
from pipeline.posing.changes import contradicted, usual_contradiction
from pipeline.posing.targets import thinned
from pipeline.running.building import build
from pipeline.running.progress import Progress


@dataclass(frozen=True)
class Growth:
    """What a site learns of a day, before it is learned."""

    adoption: Adoption
    places: Places
    new: NDArray[np.int64]
    """(scan,) the place of each; −1 outside all places of the site."""
    changed: dict[int, int]
    """Submaps that are contradicted, each with the scan that takes its place."""
    added: NDArray[np.int64]
    """Scans that the map gets besides, of new places."""

    @property
    def used(self) -> NDArray[np.int64]:
        """The scans with a place."""
        return np.flatnonzero(self.new >= 0)

    def line(self, site: Site) -> str:
        """What would be learned."""
        one = self.adoption
        known = len(site.places.cells)
        what = "surveyed" if one.surveyed else "adopted"
        wrong = (
            f", {one.wrong.sum()} of them wrong by the log's own poses" if one.wrong.any() else ""
        )
        places = f"{len(self.places.cells) - known} new places beside {known}"
        return (
            f"{len(self.used)} of {one.asked} scans {what}{wrong}; {places}; {len(self.changed)} "
            "submaps have changed"
        )


def planned(site: Site, adoption: Adoption) -> Growth:
    """What of the day's scans the site can learn; raises NothingAdoptedError where none lies in a
    place."""
    xy_m = adoption.world_T_scan[:, :2, 3]
    places = site.places.grown(xy_m) if adoption.surveyed else site.places
    new = places.at(xy_m)
    walls = site.fixer.walls
    if (new < 0).all():
        raise NothingAdoptedError(
            f"nothing to learn of {adoption.asked} scans: those adopted lie in no place of the site"
        )
    usual = usual_contradiction(site.targets, walls)
    changed = contradicted(site.targets, walls, adoption.points, adoption.world_T_scan, usual)
    return Growth(adoption, places, new, changed, np.flatnonzero(new >= len(site.places.cells)))


def grown(site: Site, parts: Parts, growth: Growth, name: str, progress: Progress) -> Parts:
    """The site with the day `name` learned; `parts` are those that it was opened from, its views
    among them."""
    about = parts.about
    views = parts.views
    used = growth.used
    known = learned(site, parts)
    seen = growth.adoption.views(site)
    new = TrainingSet(
        Rows(seen.images[used], seen.stamps_ns[used], seen.world_T_anchor[used]), growth.new[used]
    )
    held_out = {key: array for key, array in views.items() if key.startswith(HELD_OUT)}
    method = build(about["method"], ROOTS)
    model = method.grow({**parts.model, **held_out}, known, new, progress)
    number = len(about["growth"]["days"])
    every = dict(learned_from(Rows.joined([known.views, new.views]), model))
    every["days"] = np.concatenate([views["days"], np.full(len(used), number)])
    every["chances"] = np.concatenate([views["chances"], growth.adoption.chance[used]])
    counts = {
        "places": len(growth.places.cells) - len(site.places.cells),
        "changed": len(growth.changed),
    }
    days = [*about["growth"]["days"], day(name, len(used), **counts)]
    return Parts(
        {
            **about,
            "places": asdict(growth.places.grid),
            "growth": {**about["growth"], "days": days},
        },
        {key: array for key, array in model.items() if key in parts.model},
        {**mapped(site, parts, growth), "cells": growth.places.cells},
        None,
        every,
    )


def learned(site: Site, parts: Parts) -> TrainingSet:
    """The views that a site has learned, each with its place; `parts` are those that it was opened
    from."""
    views = Rows(*(parts.views[key] for key in ("images", "stamps_ns", "world_T_anchor")))
    return TrainingSet(views, site.places.at(views.world_T_anchor[:, :2, 3]))


def mapped(site: Site, parts: Parts, growth: Growth) -> Arrays:
    """The map without submaps that have changed, and with the scans that take their place or are of
    new places."""
    about = parts.about
    arrays = parts.arrays
    kept = np.setdiff1d(np.arange(len(arrays["world_T_anchor"])), list(growth.changed))
    fresh = np.unique([*growth.changed.values(), *growth.added]).astype(np.int64)
    how = about["map"]["range_m"], about["growth"]["voxel_m"]
    points = [arrays["points"][arrays["offsets"][row] : arrays["offsets"][row + 1]] for row in kept]
    points += [
        thinned(growth.adoption.points[scan], *how).astype(arrays["points"].dtype) for scan in fresh
    ]
    poses = [arrays["world_T_anchor"][kept], growth.adoption.world_T_scan[fresh]]
    return {
        "points": np.concatenate(points),
        "offsets": np.cumsum([0, *map(len, points)]),
        "world_T_anchor": np.concatenate(poses),
    }
