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
    fixes = store.read(Path(cfg.fixes, name), schemas.FIXES)
    submaps = store.read(Path(cfg.submaps, name), schemas.SUBMAPS)
    odom_T_scan = store.read(Path(cfg.scans, name), schemas.SCANS).load("odom_T_scan")
    places = Places.read(store.read(Path(cfg.labels, train), schemas.LABELS))
    columns, attrs = joined(
        fixes, odom_T_scan[submaps.load("scans")], instantiate(cfg.path), places
    )
    with store.write(folder / name, schemas.FIXES, **attrs) as out:
        for column in schemas.FIXES.columns:
            out.put(column, columns[column])
    is_accepted, was_accepted = (
        values[:, 0] < value_attrs["promised"][1]
        for values, value_attrs in (
            (columns["novelty"], attrs),
            (fixes.load("novelty"), fixes.attrs),
        )
    )
    return (
        f"{sequence}: {is_accepted.sum()} of {len(is_accepted)} queries accepted along the path, "
        f"{was_accepted.sum()} one by one"
    )


if __name__ == "__main__":
    main()
