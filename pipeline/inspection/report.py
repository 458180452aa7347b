"""`yearloc inspect`: kind, ranges, counts, frames and provenance of a file, folder or artifact, and warnings on its content."""

from pathlib import Path

from pipeline.errors import ArtifactError, ConfigError, LogError
from pipeline.formats.bag_file import SUFFIXES, find
from pipeline.formats.robotcar import LASERS
from pipeline.inspection import artifacts, bags, files, folders, origin, robotcar, robotcar_poses, tracks
from pipeline.inspection.inspection import Inspection

KNOWN = (
    ".zarr, .safetensors, .bin, .csv (NCLT poses, RobotCar vo, ins), .txt (KITTI poses, times, calib; TUM poses), .npy, .pcd, "
    ".bag, .mcap, .db3, or a folder of these"
)


def inspect(path: Path, as_format: str | None = None, lock: Path = Path("dvc.lock")) -> Inspection:
    """Inspect `path`; `as_format` (nclt or kitti) is the format of a .bin whose folder's name does not say it.

    Raises LogError, ArtifactError or ConfigError, one line each, for what is missing, damaged or of an unknown kind.
    """
    if as_format not in (None, "nclt", "kitti"):
        raise ConfigError(f"--format {as_format}: the formats are nclt and kitti")
    if not path.exists():
        if path.suffix in (".zarr", ".safetensors"):
            raise ArtifactError(f"{path}: no such artifact; `dvc repro` builds it")
        raise LogError(f"{path}: no such file or folder")
    return _folder(path, as_format, lock) if path.is_dir() else _file(path, as_format, lock)


def _folder(path: Path, as_format: str | None, lock: Path) -> Inspection:
    if path.suffix == ".zarr" or (path / "zarr.json").is_file():
        return artifacts.artifact(path, lock)
    if any((path / name).is_dir() for name in files.FORMATS):
        found = folders.sequence(path)
    elif any((path / laser).is_dir() for laser in LASERS):
        found = robotcar.sequence(path)
    elif path.name in LASERS:
        found = robotcar.sweeps(path)
    elif as_format is None and find(path):
        found = bags.bags(path)
    elif path.name in files.FORMATS or any(path.glob("*.bin")):
        found = folders.scan_folder(path, as_format)
    elif bags.below(path):
        found = bags.bags(path)
    else:
        found = folders.root(path)
    return _with_origin(found, path, lock)


def _file(path: Path, as_format: str | None, lock: Path) -> Inspection:
    if path.suffix == ".safetensors":
        return artifacts.model(path, lock)
    if path.suffix == ".bin" and path.parent.name in LASERS and as_format is None:
        found = robotcar.sweep(path)
    elif path.suffix == ".bin":
        found = files.scan_file(path, as_format)
    elif path.suffix in SUFFIXES:
        found = bags.bags(path)
    elif path.suffix == ".pcd":
        found = files.pcd_file(path)
    elif path.suffix == ".npy":
        found = files.array_file(path)
    elif path.suffix == ".csv" and path.name.startswith(("groundtruth", "odometry")):
        found = tracks.nclt_poses(path)
    elif path.name == "vo.csv":
        found = robotcar_poses.vo(path)
    elif path.name == "ins.csv":
        found = robotcar_poses.ins(path)
    elif path.name == "times.txt":
        found = tracks.kitti_times(path)
    elif path.name == "calib.txt":
        found = tracks.kitti_calib(path)
    elif path.suffix == ".txt" and path.stem.isdecimal():
        found = tracks.kitti_poses(path)
    elif path.suffix in (".txt", ".tum") and tracks.is_tum(path):
        found = tracks.tum_poses(path)
    else:
        raise ConfigError(f"{path}: no kind of file that inspect knows; it looks at {KNOWN}")
    return _with_origin(found, path, lock)


def _with_origin(found: Inspection, path: Path, lock: Path) -> Inspection:
    """The inspection with the provenance of raw files that a stage wrote, as those of the simulated world."""
    provenance = origin.origin(path, lock)
    if provenance.rows[0][0] == "unknown":
        return found
    return Inspection(found.headline, (*found.sections, provenance), found.warnings)
