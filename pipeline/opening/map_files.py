"""Opens a 3-D point-cloud map: one file, several, or folders of tiles, .pcd, .ply, .las or .laz.

A folder is found by what it holds. The metadata of Autoware beside its tiles, or beside their
folder, says which tiles there are (formats/autoware.py).
"""

import hashlib
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from pipeline.core.errors import LogError
from pipeline.core.progress import Progress
from pipeline.formats import autoware, las, pcd, ply
from pipeline.formats.autoware import Metadata
from pipeline.formats.records import Summary

SUMMARIES: dict[str, Callable[[Path], Summary]] = {
    ".pcd": pcd.summary,
    ".ply": ply.summary,
    ".las": las.summary,
    ".laz": las.summary,
}
"""What reads a file's header, by its suffix."""
BLOCKS: dict[str, Callable[[Path, int], Iterator[NDArray[np.float64]]]] = {
    ".pcd": pcd.blocks,
    ".ply": ply.blocks,
    ".las": las.blocks,
    ".laz": las.blocks,
}
"""What reads a file's points in blocks, by its suffix."""
SIMULATED = "simulated, not recorded"
"""A comment at the beginning of the map of a simulated world, as `yearloc export` writes it."""
COMMENT_BYTES = 4_096
"""The comment is looked for in so many bytes."""
KINDS = ".pcd, .ply, .las or .laz"
SCAN_SUFFIXES = (".bin", ".npy")
MESH_SUFFIXES = (".dae", ".fbx", ".glb", ".gltf", ".obj", ".off", ".stl")
METADATA_NAMES = (autoware.METADATA, "metadata.yaml")
"""Names of Autoware's metadata beside the folder of the tiles."""
MOST_POINTS = 2_000_000
"""Limit for the points of a chunk."""
FARTHEST_M = 1e11
"""Limit for a coordinate: one beyond it marks an invalid point, as an infinite one does."""
LEAST_EXTENT_M = 1.0
"""A map that is smaller along x and along y has another unit, such as degrees."""
HIGHEST_M = 2_000.0
"""Limit for the range of heights of the middle 98 % of a chunk's points."""
WIDEST_M = 50_000.0
SPARSEST_M = 5.0
"""A chunk that is wider than WIDEST_M and whose points are farther apart is in millimetres."""
LEAST_POINTS = 1_000
"""Limit for the points of a chunk whose extent tells a unit."""
SAMPLE = 50_000
"""Points of a chunk whose extent is looked at."""
LEAST_SCANS = 10
"""So many files, all of which surround the origin, are scans in the frame of the sensor."""
MESH_ADVICE = "a mesh, whose corners are no scan of its surfaces: sample points on it first"


@dataclass
class Tally:
    """What `chunks` has read so far."""

    points: int = 0
    """Number of finite points."""
    left_out: int = 0
    """Number of points that were left out since a coordinate is not finite."""
    low_m: NDArray[np.float64] = field(default_factory=lambda: np.full(3, np.inf))
    """The least x, y and z (3,) in m."""
    high_m: NDArray[np.float64] = field(default_factory=lambda: np.full(3, -np.inf))
    """The largest x, y and z (3,) in m."""
    around_origin: set[Path] = field(default_factory=set)
    """The files that have points on all sides of the origin."""
    step_m: float = 0.0
    """The largest step between neighbouring 32-bit floats at the coordinates so stored.

    It is .25 m for UTM northings of 4,000 km, and 0 if no file stores 32-bit floats.
    """


@dataclass(frozen=True)
class MapFiles:
    """The files of a 3-D point-cloud map, in the order of their names."""

    files: tuple[Path, ...]
    name: str
    """The name of the first path without its suffix, of a yaml that of its folder."""
    notes: tuple[str, ...] = ()
    """Lines for the user on what is left out."""
    tally: Tally = field(default_factory=Tally, init=False, compare=False, repr=False)
    """What the last call of `chunks` has read."""

    @classmethod
    def of(cls, paths: Sequence[Path]) -> Self:
        """The map at these paths: files, and folders that hold tiles or one folder of tiles.

        Raises LogError for a path that is no map, and for a tile that Autoware's metadata names and
        that is missing.
        """
        if not paths:
            raise LogError(f"no map named; expected {KINDS} files or a folder of them")
        files: list[Path] = []
        notes: list[str] = []
        for path in paths:
            tiles, note = _at(path)
            files += tiles
            notes += [note] if note else []
        unique = {file.resolve(): file for file in files}.values()
        ordered = sorted(unique, key=lambda file: (file.name, file.parent.name))
        return cls(tuple(ordered), _name(paths[0]), tuple(notes))

    @cached_property
    def summaries(self) -> tuple[Summary, ...]:
        """What the header of each file says: its points, and whether they are 32-bit floats.

        Raises LogError for a damaged header and for a mesh, NotInstalledError for .las and .laz
        without the extra `las`.
        """
        return tuple(_summary(file) for file in self.files)

    @property
    def are_float32(self) -> tuple[bool, ...]:
        """Whether each file stores coordinates as 32-bit floats; raises as `summaries`."""
        return tuple(summary.is_float32 for summary in self.summaries)

    @property
    def is_simulated(self) -> bool:
        """Whether a file says that the map is of a simulated world."""
        heads = []
        for path in self.files:
            with path.open("rb") as file:
                heads.append(file.read(COMMENT_BYTES))
        return any(SIMULATED.encode() in head for head in heads)

    def chunks(self, progress: Progress) -> Iterator[NDArray[np.float64]]:
        """The finite points of all files in chunks (n, 3) in m, of at most MOST_POINTS, never none.

        Meanwhile `tally` is filled. Raises LogError for a damaged file, for coordinates in another
        unit and, at the end, for a map without points or without heights; NotInstalledError as
        `summaries`.
        """
        tally = self.tally
        vars(tally).update(vars(Tally()))
        # the headers of all files are looked at before the first points
        count = sum(-(-summary.points // MOST_POINTS) for summary in self.summaries)
        for file, is_float32, block in progress.track(self._blocks(), count, "read the map"):
            is_finite = (np.abs(block) < FARTHEST_M).all(axis=1)
            points = block if is_finite.all() else block[is_finite]
            tally.left_out += len(block) - len(points)
            if not len(points):
                continue
            _refuse_millimetres(file, points)
            tally.points += len(points)
            low_m = points.min(axis=0)
            high_m = points.max(axis=0)
            tally.low_m = np.minimum(tally.low_m, low_m)
            tally.high_m = np.maximum(tally.high_m, high_m)
            if (low_m[:2] < 0).all() and (high_m[:2] > 0).all():
                tally.around_origin.add(file)
            if is_float32:
                farthest = np.abs(points).max().astype(np.float32)
                tally.step_m = max(tally.step_m, float(np.spacing(farthest)))
            yield points
        self._refuse_no_map()

    def digest(self) -> str:
        """The md5 over the names and the bytes of all files."""
        digest = hashlib.md5(usedforsecurity=False)
        for path in self.files:
            with path.open("rb") as file:
                content = hashlib.file_digest(
                    file, lambda: hashlib.md5(usedforsecurity=False)
                ).hexdigest()
            digest.update(f"{path.name}\0{content}\0".encode(errors="surrogateescape"))
        return digest.hexdigest()

    def _blocks(self) -> Iterator[tuple[Path, bool, NDArray[np.float64]]]:
        """Each block of points (n, 3), with its file and whether that stores 32-bit floats."""
        for file, is_float32 in zip(self.files, self.are_float32, strict=True):
            for block in BLOCKS[_suffix(file)](file, MOST_POINTS):
                yield file, is_float32, block

    def _refuse_no_map(self) -> None:
        """Raise LogError if all that was read makes no map."""
        tally = self.tally
        place = self.files[0] if len(self.files) == 1 else self.files[0].parent
        if not tally.points and tally.left_out:
            raise LogError(f"{place}: none of its {tally.left_out} points is finite; save it again")
        if not tally.points:
            raise LogError(f"{place}: holds no points; is it the whole map?")
        if len(tally.around_origin) == len(self.files) >= LEAST_SCANS:
            raise LogError(
                f"{place}: each of its {len(self.files)} files surrounds the origin, as scans in "
                "the sensor's frame do; a map has the points of all scans in one frame"
            )
        x_m, y_m, height_m = tally.high_m - tally.low_m
        if max(x_m, y_m) < LEAST_EXTENT_M:
            raise LogError(
                f"{place}: its points span {x_m:.6f} x {y_m:.6f}, which is no map in metres; "
                "project degrees to metres first, such as UTM"
            )
        if height_m == 0:
            raise LogError(
                f"{place}: all points have the height {tally.low_m[2]:g}, a 2-D map; for a level "
                "laser pack the .yaml of a Nav2 map: `yearloc pack --map hall.yaml`"
            )


def _at(path: Path) -> tuple[list[Path], str]:
    """The files of the map at a path, and a line on what is left out or an empty one."""
    if path.is_dir():
        return _in_folder(path)
    if not path.exists():
        raise LogError(f"{path}: no such map; expected a {KINDS} file, or a folder of them")
    suffix = _suffix(path)
    if suffix in BLOCKS:
        return [path], ""
    if suffix in (".yaml", ".yml"):
        metadata = autoware.read_metadata(path)
        if metadata:
            return _named(path, metadata, [path.parent, *_subfolders(path.parent)])
    if suffix in SCAN_SUFFIXES:
        raise LogError(
            f"{path}: one scan, not a map; expected {KINDS} with the points of all scans in one "
            "frame"
        )
    if suffix in MESH_SUFFIXES:
        raise LogError(f"{path}: {MESH_ADVICE}, and save them as .ply")
    raise LogError(f"{path}: no point-cloud map that is read; expected {KINDS}: convert it")


def _in_folder(folder: Path) -> tuple[list[Path], str]:
    """The tiles in a folder or in its only subfolder with tiles, and a line as of `_at`."""
    subfolders = _subfolders(folder)
    for path in sorted([*folder.glob("*.yaml"), *folder.glob("*.yml")]):
        metadata = autoware.read_metadata(path) if path.is_file() else None
        if metadata:
            return _named(path, metadata, [folder, *subfolders])
    clouds = _clouds(folder)
    if clouds:
        return _beside_metadata(folder) or (clouds, "")
    inner = [subfolder for subfolder in subfolders if _clouds(subfolder)]
    if len(inner) > 1:
        names = ", ".join(subfolder.name for subfolder in inner[:5])
        raise LogError(f"{folder}: {len(inner)} folders in it hold clouds ({names}); name one")
    if inner:
        return _in_folder(inner[0])
    if any(_suffix(path) in SCAN_SUFFIXES for path in folder.iterdir()):
        raise LogError(
            f"{folder}: holds scans, not a map; expected {KINDS} with the points of all scans in "
            "one frame"
        )
    raise LogError(f"{folder}: holds no {KINDS}, and no folder in it does")


def _beside_metadata(folder: Path) -> tuple[list[Path], str] | None:
    """The tiles of a folder by the metadata beside it; None if there is none of its tiles."""
    for name in METADATA_NAMES:
        path = folder.resolve().parent / name
        metadata = autoware.read_metadata(path) if path.is_file() else None
        if metadata and any((folder / tile).is_file() for tile in metadata.corners_m):
            return _named(path, metadata, [folder])
    return None


def _named(path: Path, metadata: Metadata, folders: Iterable[Path]) -> tuple[list[Path], str]:
    """The tiles that the metadata at `path` names, in the first of the folders that has any."""
    names = [Path(tile).name for tile in metadata.corners_m]
    if not names:
        raise LogError(f"{path}: names no tile")
    holders = [folder for folder in folders if any((folder / name).is_file() for name in names)]
    folder = holders[0] if holders else path.parent
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        raise LogError(
            f"{folder}: no tile {missing[0]}, which {path.name} names ({len(missing)} of "
            f"{len(names)} are missing); copy the whole folder"
        )
    others = sorted({file.name for file in _clouds(folder)} - set(names))
    note = f"{folder}: {path.name} does not name {others[0]}" if others else ""
    if len(others) > 1:
        note += f" and {len(others) - 1} more"
    return [folder / name for name in names], f"{note}, left out" if note else ""


def _clouds(folder: Path) -> list[Path]:
    """The files with points in a folder, without hidden ones."""
    return [
        path
        for path in sorted(folder.iterdir())
        if _suffix(path) in BLOCKS and not path.name.startswith(".") and path.is_file()
    ]


def _subfolders(folder: Path) -> list[Path]:
    """The folders in a folder, without hidden ones."""
    return [
        path for path in sorted(folder.iterdir()) if path.is_dir() and not path.name.startswith(".")
    ]


def _summary(file: Path) -> Summary:
    """What the header of a file says; raises LogError for a mesh."""
    summary = SUMMARIES[_suffix(file)](file)
    if summary.faces:
        raise LogError(f"{file}: {summary.faces} faces, {MESH_ADVICE}")
    return summary


def _refuse_millimetres(file: Path, points: NDArray[np.float64]) -> None:
    """Raise LogError if a chunk (n, 3) extends farther than a map in metres does."""
    if len(points) < LEAST_POINTS:
        return
    # stray points do not count
    sample = points[:: max(1, len(points) // SAMPLE)]
    low, high = np.percentile(sample, (1, 99), axis=0)
    x, y, height = high - low
    is_far = height > HIGHEST_M
    if not is_far and max(x, y) > WIDEST_M:
        distances = np.asarray(cKDTree(points).query(sample[::10], k=2)[0])
        is_far = bool(np.median(distances[:, 1]) > SPARSEST_M)
    if is_far:
        raise LogError(
            f"{file}: its points span {x:,.0f} x {y:,.0f} x {height:,.0f}, too far for metres; if "
            "they are millimetres, divide them by 1000"
        )


def _suffix(path: Path) -> str:
    return path.suffix.lower()


def _name(path: Path) -> str:
    """The name of a map at a path."""
    resolved = path.resolve()
    if not resolved.is_dir() and _suffix(resolved) not in BLOCKS:
        resolved = resolved.parent  # the folder of a yaml
    # of a folder too, which Autoware may name pointcloud_map.pcd
    return resolved.stem if _suffix(resolved) in BLOCKS else resolved.name
