"""The training day's submaps → a map of each: its points, thinned, to register queries against."""

from pathlib import Path

from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.posing.targets import write_map
from stages import ProgressBar, stage


@stage("map")
def main(cfg: DictConfig) -> str:
    lines = []
    trained = cfg.train.split()
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        for sequence in ProgressBar().track(trained, len(trained), "thin"):
            scans = store.read(Path(cfg.scans, f"{sequence}.zarr"), schemas.Scans)
            submaps = store.read(Path(cfg.submaps, f"{sequence}.zarr"), schemas.Submaps)
            count, points = write_map(
                folder / f"{sequence}.zarr",
                scans,
                submaps,
                cfg.voxel_m,
                cfg.range_m,
                cfg.gathered_m,
            )
            lines.append(
                f"{sequence}: {count} submaps, {points / 1e6:.1f} M points in voxels of "
                f"{cfg.voxel_m} m"
            )
    return "; ".join(lines)


if __name__ == "__main__":
    main()
