"""Poses of single queries and odometry → poses along each test sequence's path."""

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.matching.places import Places
from pipeline.paths.tracks import joined
from stages import ProgressBar, stage


@stage("paths")
def main(cfg: DictConfig) -> str:
    sequences = cfg.sequences.split()
    lines = []
    with instantiate(cfg.compute) as compute, store.replace(cfg.out) as folder:
        folder.mkdir()
        written_lines = compute.each(lambda sequence: follow(cfg, sequence, folder), sequences)
        lines = list(ProgressBar().track(written_lines, len(sequences), "paths"))
    return "; ".join(lines)


def follow(cfg: DictConfig, sequence: str, folder: Path) -> str:
    """Write the poses of one sequence anew; it may run in a process of its own."""
    name = f"{sequence}.zarr"
    train = f"{cfg.train}.zarr"
    fixes = store.read(Path(cfg.fixes, name), schemas.Fixes)
    submaps = store.read(Path(cfg.submaps, name), schemas.Submaps)
    odom_T_scan = store.read(Path(cfg.scans, name), schemas.Scans).odom_T_scan
    places = Places.of(store.read(Path(cfg.labels, train), schemas.Labels))
    along_path = joined(fixes, odom_T_scan[submaps.scans], instantiate(cfg.path), places)
    store.write(folder / name, along_path)
    is_accepted, was_accepted = (
        answers.novelty[:, 0] < answers.promised[1] for answers in (along_path, fixes)
    )
    return (
        f"{sequence}: {is_accepted.sum()} of {len(is_accepted)} queries accepted along the path, "
        f"{was_accepted.sum()} one by one"
    )


if __name__ == "__main__":
    main()
