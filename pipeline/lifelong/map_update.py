"""Updates the site of a 3-D map: labelled scans in, the site with the changed map out (METHODS 15).

1. Each scan says which columns of the map have walls, and which it saw through.
2. Walls of the map that several scans saw through, and that none hit, are removed.
3. Walls that several scans hit, where the map has none, are added with all that stands there. With
   reference poses, streets that the map lacks are added too.
4. Ground, walls and anchors are made again, as `yearloc pack --map` makes them.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter

from pipeline.core.frames import transformed
from pipeline.core.progress import Progress
from pipeline.lifelong.pseudo_labels import NoPseudoLabelsError, PseudoLabels
from pipeline.mapping.tiled_map import Thinning
from pipeline.mapping.wall_chart import SEEN_THROUGH, WALL
from pipeline.online.map_pack import MapOptions, parts_of_map
from pipeline.online.site import Site
from pipeline.online.site_file import Parts
from pipeline.online.site_json import Increments, LearnedDay
from pipeline.posing.cut_outs import CutOuts

FEWEST_SCANS = 3
"""So many scans must have seen through a wall that is removed, or hit a wall that is added."""
ADDED_M = 40.0
"""Points farther from the sensor are not added."""
STANDS_M = 0.5
"""Points of a removed wall are those higher than this above the ground."""


@dataclass(frozen=True)
class MapUpdate:
    """A plan of what the site of a map would learn of a day."""

    pseudo_labels: PseudoLabels
    corner: NDArray[np.int64]
    """(2,) the lower corner of the masks below, in whole cells of the world."""
    cell_m: float
    is_removed: NDArray[np.bool_]
    """(x, y) the columns whose walls are removed."""
    is_added: NDArray[np.bool_]
    """(x, y) the columns in which the points of scans are added."""

    def line(self, site: Site) -> str:
        """Describe the plan in a line."""
        labels = self.pseudo_labels
        gone_m2, new_m2 = (mask.sum() * self.cell_m**2 for mask in (self.is_removed, self.is_added))
        return (
            f"{labels.words(len(labels.points))}; walls on {gone_m2:.0f} m² are gone, points on "
            f"{new_m2:.0f} m² are new"
        )

    def is_in(self, points_m: NDArray[np.float64], mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Whether each point (n, 3) lies in a column of a mask (x, y)."""
        cell = np.floor(points_m[:, :2] / self.cell_m).astype(np.int64) - self.corner
        is_inside = ((cell >= 0) & (cell < mask.shape)).all(axis=1)
        is_in_mask = np.zeros(len(points_m), bool)
        is_in_mask[is_inside] = mask[tuple(cell[is_inside].T)]
        return is_in_mask


def planned_map(site: Site, targets: CutOuts, pseudo_labels: PseudoLabels) -> MapUpdate:
    """Plan what the site of a map, with these targets, can learn from labelled scans.

    Raises NoPseudoLabelsError if the map has all that the scans show.
    """
    drawn = targets.drawn
    map_low = np.rint(drawn.corner_m / drawn.cell_m).astype(np.int64)
    hit, through = _voted_cells(site, pseudo_labels, drawn.cell_m)
    ends = [map_low, map_low + drawn.counts.shape]
    low = np.concatenate([hit, through, ends]).min(axis=0)
    shape = np.concatenate([hit, through, ends]).max(axis=0) - low + 1
    hits, views_through = (_counted(cells - low, shape) for cells in (hit, through))

    has_wall, is_known = np.zeros(shape, bool), np.zeros(shape, bool)
    (x, y), (x_end, y_end) = ends - low
    has_wall[x:x_end, y:y_end] = drawn.counts > 0
    is_known[x:x_end, y:y_end] = drawn.is_candidate
    is_removed = has_wall & (views_through >= FEWEST_SCANS) & (hits == 0)
    is_added = ~maximum_filter(has_wall, 3) & (hits >= FEWEST_SCANS) & is_known
    if pseudo_labels.has_reference_poses:
        is_added |= ~is_known & (hits + views_through > 0)
    if not is_removed.any() and not is_added.any():
        raise NoPseudoLabelsError(
            f"nothing to learn of {pseudo_labels.scan_count} scans: the map has all that they show"
        )
    return MapUpdate(pseudo_labels, low, drawn.cell_m, is_removed, is_added)


def updated_map_site(
    targets: CutOuts, parts: Parts, update: MapUpdate, name: str, progress: Progress
) -> Parts:
    """The parts of a map's site after it learned the day `name`, as `update` plans it.

    `parts` are the parts that the site was opened from, `targets` its targets.
    """
    description = parts.description
    options = MapOptions(voxel_m=description.map.voxel_m or MapOptions().voxel_m)
    thinning = Thinning(options.voxel_m)
    for points_m, above_m in targets.heights():
        is_gone = (above_m > STANDS_M) & update.is_in(points_m, update.is_removed)
        thinning.add(points_m[~is_gone])
    labels = update.pseudo_labels
    for points_m, pose in zip(labels.points, labels.world_T_scan, strict=True):
        is_near = np.hypot(points_m[:, 0], points_m[:, 1]) < ADDED_M
        world_m = transformed(pose, points_m[is_near])
        thinning.add(world_m[update.is_in(world_m, update.is_added)])
    digests = dict(description.provenance.md5)
    renewed, _ = parts_of_map(thinning.tiled(), description.name, digests, options, progress)

    days: tuple[LearnedDay, ...] = (LearnedDay(description.provenance.train, 0),)
    if description.incremental_learning is not None:
        days = tuple(description.incremental_learning.days)
    new_places = len(renewed.arrays["cells"]) - len(parts.arrays["cells"])
    changed = int(update.is_removed.sum() + update.is_added.sum())
    day = LearnedDay(name, len(labels.points), max(new_places, 0), changed)
    kept = replace(
        renewed.description,
        simulated=description.simulated,
        verdict=description.verdict,
        sensor=description.sensor,
        provenance=description.provenance,
        incremental_learning=Increments(options.voxel_m, (*days, day)),
    )
    return renewed._replace(description=kept)


def _voted_cells(
    site: Site, labels: PseudoLabels, cell_m: float
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The cells (n, 2) of the world in which scans hit a wall, and those they saw through.

    A cell is listed once for each scan.
    """
    hit = [np.empty((0, 2), np.int64)]
    through = [np.empty((0, 2), np.int64)]
    for points_m, pose in zip(labels.points, labels.world_T_scan, strict=True):
        image = site.view(points_m)
        for value, cells in ((WALL, hit), (SEEN_THROUGH, through)):
            middles_m = (np.argwhere(image == value) - len(image) // 2 + 0.5) * cell_m
            level_m = np.column_stack([middles_m, np.zeros(len(middles_m))])
            world_m = transformed(pose, level_m)[:, :2]
            cells.append(np.unique(np.floor(world_m / cell_m).astype(np.int64), axis=0))
    return np.concatenate(hit), np.concatenate(through)


def _counted(cells: NDArray[np.int64], shape: NDArray[np.int64]) -> NDArray[np.int64]:
    """How often each cell of a grid (x, y) is among cells (n, 2)."""
    counts = np.bincount(cells @ (int(shape[1]), 1), minlength=int(shape.prod()))
    return counts.reshape(shape)
