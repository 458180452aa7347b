"""Describes a 3-D point-cloud map for `yearloc inspect`, before it is packed into a site.

What is found is about the thinned map: its ground, its walls and its storeys.
"""

import shlex
from collections import Counter
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.core.progress import Progress
from pipeline.inspection.inspection import Inspection, box, metres, nbytes, typographic
from pipeline.inspection.point_map import VOXEL_M, PointMap
from pipeline.mapping.local_ground import CELL_M, USUAL_CUT_M, LocalGround
from pipeline.mapping.no_map import upward
from pipeline.mapping.storeys import Storeys, storeys
from pipeline.mapping.tiled_map import TiledMap
from pipeline.views.walls import Walls

COLUMN_M = 1.0
"""A column of this width is covered if it has a voxel."""
LARGE_M = 100_000.0
"""Coordinates beyond this are of a country's grid, such as UTM."""
ROUND_M = 1_000.0
"""A proposed origin is a multiple of this."""
COARSE_M = 0.02
"""32-bit floats that are farther apart than this move walls."""
STOREYS_SHARE = 0.1
"""A map with storeys in this share of its cells is one of a building."""
NOTABLE_CELLS = 3
"""Fewer cells with storeys are chance."""


def describe_map(path: Path, inspection: Inspection, progress: Progress) -> None:
    """Describe the 3-D map at a path, a file or a folder of tiles; raises as `PointMap.read`."""
    point_map = PointMap.read(path, progress)
    inspection.kind = "3-D map"
    inspection.point_map = point_map
    for note in point_map.files.notes:
        inspection.warn(note)
    inspection.add("", *_file_rows(point_map, inspection))
    if not point_map.tiled.unfit:
        inspection.add("seen from above", *_extent_rows(point_map))
    if point_map.ground is None:
        reason = point_map.tiled.unfit or "too few points for a ground, in each cell of 10 m"
        inspection.warn(f"it cannot be packed: {reason}")
        return
    inspection.add("ground", *_ground_rows(point_map, point_map.ground))
    other = upward(point_map.tiled)
    if other:
        up, coordinates = other
        inspection.warn(
            f"{up} seems to be up, not z: the points lie on a ground along it; save each point as "
            f"{coordinates}, and inspect that before you pack it"
        )
        return
    is_packed = _add_walls(inspection, point_map.tiled, point_map.ground, progress)
    inspection.warn_if(
        point_map.is_one_scan,
        "one scan rather than a map: its points are the farther apart the farther they are from "
        "one place; a site needs the points of all scans in one frame, as `yearloc slam` or a SLAM "
        "of yours makes it",
    )
    if is_packed:
        inspection.next = _command(path, point_map)


def _file_rows(point_map: PointMap, inspection: Inspection) -> list[tuple[str, str]]:
    """Rows on the files: formats, points, fields, coordinates; warns of coarse coordinates."""
    files = point_map.files
    tally = files.tally
    kinds = Counter(file.suffix.lower() for file in files.files)
    counted = ", ".join(f"{count:,} {suffix}" for suffix, count in sorted(kinds.items()))
    size = nbytes(sum(file.stat().st_size for file in files.files))
    points = f"{tally.points:,}"
    if tally.left_out:
        points += f", and {tally.left_out:,} that are not finite, left out"
    # fields in the order of the files that name them first
    others = dict.fromkeys(name for summary in files.summaries for name in summary.others)
    left_out = f"left out: {', '.join(others)}" if others else "x, y and z alone"
    farthest_m = float(np.abs([tally.low_m[:2], tally.high_m[:2]]).max())
    origin = _origin(tally.low_m, tally.high_m)
    are_float32 = files.are_float32
    stored = "32-bit floats" if all(are_float32) else "64-bit floats"
    if any(are_float32) and not all(are_float32):
        stored = "32-bit floats in some files"
    if all(file.suffix.lower() in (".las", ".laz") for file in files.files):
        stored = "scaled whole numbers"
    if tally.step_m:
        stored += f", steps of {metres(tally.step_m)}"
    inspection.warn_if(
        tally.step_m > COARSE_M,
        f"coordinates up to {farthest_m:,.0f} m in 32-bit floats are rounded to "
        f"{tally.step_m:g} m: export the map again with 64-bit floats (PCD: SIZE 8, or .laz), or "
        f"with the origin {origin} subtracted before it is saved",
    )
    rows = [
        ("files", f"{counted}, {size}"),
        ("points", points),
        ("fields", left_out),
        ("coordinates", stored),
        ("extent", box(np.array([tally.low_m, tally.high_m]), ("x", "y", "z"))),
    ]
    if farthest_m > LARGE_M and tally.step_m <= COARSE_M:
        rows.append(
            (
                "origin",
                f"a country's grid: nothing is rounded. `--origin {origin}` gives the site small "
                "numbers; without it, its poses are in the map's coordinates",
            )
        )
    return rows


def _extent_rows(point_map: PointMap) -> list[tuple[str, str]]:
    """Rows on the thinned map: its size, its density and its strays."""
    tiled = point_map.tiled
    low_m, high_m = tiled.box_m
    sides_m = high_m - low_m
    covered_m2 = 0.0
    for points_m in tiled.tiles_m():
        columns = np.unique(np.floor(points_m[:, :2] / COLUMN_M), axis=0)
        covered_m2 += len(columns) * COLUMN_M**2
    voxels = len(tiled.points)
    rows = [
        ("size", f"{metres(sides_m[0])} × {metres(sides_m[1])}, {metres(sides_m[2])} high"),
        ("covered", f"{_area(covered_m2)}, in {len(tiled):,} tiles of 50 m"),
        (
            "density",
            f"{point_map.files.tally.points / covered_m2:,.3g} points, or {voxels / covered_m2:.1f}"
            f" voxels of {VOXEL_M:g} m, a covered m²",
        ),
    ]
    if point_map.strays:
        rows.append(
            ("strays", f"{point_map.strays:,} voxels in nearly empty tiles, which are left out")
        )
    return rows


def _ground_rows(point_map: PointMap, ground: LocalGround) -> list[tuple[str, str]]:
    """Rows on the ground: whether it is there, its tilt and its heights."""
    shown = "in the map"
    if not ground.has_ground:
        shown = (
            f"cut off: the lowest points are taken to be {USUAL_CUT_M:g} m above it; `--like SCAN`,"
            " a scan of your robot with its ground cut off as in the map, tells the height"
        )
    tilt_deg = ground.tilt_deg[np.isfinite(ground.tilt_deg)]
    cells_m = np.concatenate(
        [
            np.unique(np.floor(tile_m[:, :2] / CELL_M), axis=0)
            for tile_m in point_map.tiled.tiles_m()
        ]
    )
    heights_m = ground.heights_m((cells_m + 0.5) * CELL_M)
    low_m, high_m = np.nanquantile(heights_m, (0.01, 0.99))
    whole_deg = _slope_deg(cells_m * CELL_M, heights_m)
    return [
        ("shown", shown),
        (
            "tilt",
            f"the whole map {whole_deg:.1f}°; its cells of {CELL_M:g} m {np.median(tilt_deg):.1f}°"
            f" in the median, at most {np.quantile(tilt_deg, 0.99):.1f}° in 99 % of them",
        ),
        ("height", typographic(f"z {low_m:.1f} … {high_m:.1f} m in 98 % of the cells")),
    ]


def _slope_deg(xy_m: NDArray[np.float64], heights_m: NDArray[np.float64]) -> float:
    """The slope of the plane through positions (n, 2) with heights (n,), of which some are NaN."""
    is_known = np.isfinite(heights_m)
    from_middle_m = xy_m[is_known] - xy_m[is_known].mean(axis=0)
    known_m = heights_m[is_known] - heights_m[is_known].mean()
    slope = np.linalg.lstsq(from_middle_m, known_m)[0]
    return float(np.rad2deg(np.arctan(np.hypot(*slope))))


def _add_walls(
    inspection: Inspection, tiled: TiledMap, ground: LocalGround, progress: Progress
) -> bool:
    """Add what the search looks at, and storeys; returns whether there are any walls."""
    view = Walls()
    wall_m2 = 0.0
    for points_m in tiled.tiles_m():
        above_m = points_m[:, 2] - ground.heights_m(points_m[:, :2])
        wall_m = points_m[(above_m > view.low_m) & (above_m < view.high_m), :2]
        wall_m2 += len(np.unique(np.floor(wall_m / view.cell_m), axis=0)) * view.cell_m**2
    heights = f"{view.low_m:g}–{view.high_m:g} m above the ground"
    found = storeys(progress.track(tiled.tiles_m(), len(tiled), "look for storeys"), ground)
    inspection.add(
        "what is searched",
        ("walls", f"{_area(wall_m2)} with points {heights}"),
        ("storeys", _storeys_text(found)),
    )
    inspection.warn_if(
        not wall_m2,
        f"it cannot be packed: nothing stands {heights}; a map without walls or trees cannot be "
        "searched",
    )
    inspection.warn_if(
        found.above > max(NOTABLE_CELLS, STOREYS_SHARE * found.cells),
        f"several storeys: the search looks at the walls {heights}, of the lowest one, so floors "
        "above each other are not told apart; cut the map by height, and pack each storey as a map "
        "of its own",
    )
    return bool(wall_m2)


def _storeys_text(found: Storeys) -> str:
    """What was found of storeys, in words."""
    if found.above <= NOTABLE_CELLS:
        return "one"
    share = 100 * found.above / found.cells
    area = _area(found.above * CELL_M**2)
    return (
        f"floors above each other on {area}, {share:.2g} % of the map, about "
        f"{found.apart_m:.1f} m apart"
    )


def _origin(low_m: NDArray[np.float64], high_m: NDArray[np.float64]) -> str:
    """A round position near the middle of a box, as `--origin` takes it."""
    x_m, y_m = np.rint((low_m + high_m)[:2] / 2 / ROUND_M) * ROUND_M
    return f"{x_m:.0f},{y_m:.0f},0"


def _area(area_m2: float) -> str:
    """An area: 340 m², 2.5 ha, 1.3 km²."""
    if area_m2 < 10_000:
        return f"{area_m2:,.0f} m²"
    return f"{area_m2 / 1e4:.3g} ha" if area_m2 < 1e6 else f"{area_m2 / 1e6:.3g} km²"


def _command(path: Path, point_map: PointMap) -> str:
    """The command that packs a map, with the options that it needs."""
    assert point_map.ground is not None
    like = "" if point_map.ground.has_ground else " --like SCAN"
    site = shlex.quote(f"{point_map.files.name}.site")
    return f"yearloc pack --map {shlex.quote(str(path))}{like} -o {site}"
