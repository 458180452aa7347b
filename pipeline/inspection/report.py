"""`yearloc inspect`: describes a file, folder or artifact, and warns of faults in it.

This module finds out what lies at a path and calls the function that describes it; the description
has the kind, ranges, counts, frames and provenance.
"""

from collections.abc import Callable
from pathlib import Path

from pipeline.core.errors import ArtifactError, ConfigError, LogError
from pipeline.core.progress import Progress
from pipeline.core.store import MODEL
from pipeline.formats.bag_file import SUFFIXES, find
from pipeline.formats.folder import SCANS
from pipeline.formats.robotcar import LASERS
from pipeline.inspection import artifacts, bags, files, folders, robotcar, tracks
from pipeline.inspection.inspection import Inspection
from pipeline.inspection.maps import describe_map
from pipeline.inspection.origin import add_provenance
from pipeline.inspection.scan_or_map import is_map_file, is_map_folder
from pipeline.opening.opening import OTHER_ROBOT, Opening, at
from pipeline.readers.folder import Folder
from pipeline.readers.robotcar import RobotCar

SUPPORTED_TEXT = (
    ".zarr, .zarr.zip (a model), .bin, .csv (NCLT poses, RobotCar vo, ins), .txt (KITTI poses, "
    "times, calib; TUM poses), .npy, .pcd, .ply, .las, .laz, .yaml (Autoware's tiles), .bag, "
    ".mcap, .db3, .log and .clf (CARMEN), or a folder of these"
)
"""What can be inspected, for an error."""
ZSTD = "packed: name the folder of the bag that it belongs to, or unpack it with `zstd -d FILE`"
FOREIGN_FORMATS = {
    ".pcap": (
        "packets of a lidar: play them through its driver, and record the points topic with `ros2 "
        "bag record`"
    ),
    ".osf": "Ouster's recording: save it as a bag with Ouster's own tools, and inspect that",
    ".zst": ZSTD,
    ".zstd": ZSTD,
    ".gz": "packed: unpack it with `gunzip FILE`",
}
"""For each suffix of a format that yearloc does not read: what it holds, and what to do with it."""
DESCRIBE_BY_PATTERN: dict[str, Callable[[Path, Inspection], None]] = {
    f"*{MODEL}": artifacts.describe_model,
    **{f"*{suffix}": bags.describe_bags for suffix in SUFFIXES},
    "*.pcd": files.describe_own_scan,
    "*.npy": files.describe_own_scan,
    "odometry_cov*.csv": tracks.describe_nclt_poses,
    "vo.csv": robotcar.describe_vo,
    "ins.csv": robotcar.describe_ins,
    "calib.txt": tracks.describe_kitti_calib,
}
"""The function that describes a file, by a pattern of its name.

The name of a .bin, or of a text with poses or times, does not say enough: its content is looked at.
"""
MAP = "map"
"""The format of a 3-D map."""
TEXT_SUFFIXES = (".txt", ".tum", ".csv")
"""Suffixes of texts with poses or times."""


def inspect(
    path: Path,
    as_format: str | None = None,
    lock: Path = Path("dvc.lock"),
    folder_reader: Folder | None = None,
    progress: Progress | None = None,
) -> Inspection:
    """Describe the file, folder or artifact at `path`.

    `as_format` (nclt or kitti) is the format of a .bin whose folder's name does not say it; with
    `map` a cloud is described as a 3-D map, though it looks like a scan. `lock` has the provenance
    of artifacts. `folder_reader` reads folders of another robot's scans and poses; None: one with
    its defaults.

    Raises LogError, ArtifactError or ConfigError, one line each, for what is missing, damaged or of
    an unknown kind.
    """
    if as_format not in (None, "nclt", "kitti", MAP):
        raise ConfigError(f"--format {as_format}: the formats are nclt, kitti and map")
    if not path.exists():
        if path.name.endswith((".zarr", MODEL)):
            raise ArtifactError(f"{path}: no such artifact; `dvc repro` builds it")
        raise LogError(f"{path}: no such file or folder")
    inspection = Inspection(path)
    is_group = path.is_dir() and (path.suffix == ".zarr" or (path / "zarr.json").is_file())
    if is_group:
        artifacts.describe_artifact(path, inspection)
    elif as_format == MAP or _is_map(path, as_format, folder_reader or Folder()):
        describe_map(path, inspection, progress or Progress())
    elif path.is_dir():
        _describe_folder(path, as_format, folder_reader or Folder(), inspection)
    else:
        _describe_file(path, as_format, inspection)
    add_provenance(inspection, path, lock, is_artifact=is_group or path.name.endswith(MODEL))
    return inspection


def _is_map(path: Path, as_format: str | None, folder_reader: Folder) -> bool:
    """Whether a file or a folder is a 3-D map; the folder of a log is none."""
    if as_format is not None:
        return False
    if path.is_file():
        return is_map_file(path)
    full_path = path.resolve()
    if at(path) is not None or full_path.name in folder_reader.sequences(full_path.parent):
        return False
    return is_map_folder(path)


def _describe_folder(
    path: Path, as_format: str | None, folder_reader: Folder, inspection: Inspection
) -> None:
    """Describe a folder by what lies in it."""
    is_scans = path.name in files.FORMATS or any(file.suffix in SCANS for file in path.iterdir())
    full_path = path.resolve()
    opening = at(path)
    if opening is None and full_path.name in folder_reader.sequences(full_path.parent):
        opening = Opening(OTHER_ROBOT, folder_reader, full_path.parent, full_path.name)
    if path.name in LASERS:
        robotcar.describe_sweeps(path, inspection)
    elif opening is not None and isinstance(opening.reader, RobotCar):
        robotcar.describe_sequence(opening, inspection)
    elif opening is not None:
        folders.describe_sequence(opening, inspection)
    elif (as_format is None and find(path)) or (not is_scans and bags.below(path)):
        bags.describe_bags(path, inspection)
    elif is_scans:
        folders.describe_scan_folder(path, as_format, inspection)
    else:
        folders.describe_root(path, folder_reader, inspection)


def _describe_file(path: Path, as_format: str | None, inspection: Inspection) -> None:
    """Describe a file by its name, else by its content."""
    patterns = [pattern for pattern in DESCRIBE_BY_PATTERN if path.match(pattern)]
    opening = at(path)
    if patterns:
        describe = DESCRIBE_BY_PATTERN[patterns[0]]
        describe(path, inspection)
    elif path.suffix == ".bin" and path.parent.name in LASERS and as_format is None:
        robotcar.describe_sweep(path, inspection)
    elif path.suffix == ".bin":
        files.describe_scan_file(path, as_format, inspection)
    elif path.suffix in TEXT_SUFFIXES:
        tracks.describe_numbers(path, inspection)
    elif opening is not None:
        folders.describe_carmen_log(opening, inspection)
    elif path.suffix in FOREIGN_FORMATS:
        raise ConfigError(f"{path}: {FOREIGN_FORMATS[path.suffix]}")
    else:
        raise ConfigError(
            f"{path}: no kind of file that inspect knows; it looks at {SUPPORTED_TEXT}"
        )
