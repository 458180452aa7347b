"""Scans → submaps: one every `step_m` of path, each around an anchor pose."""

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.errors import ArtifactError
from pipeline.running.progress import Progress
from stages import ProgressBar, stage


@stage("submaps")
def main(cfg: DictConfig) -> str:
    sequences = cfg.sequences.split()
    with instantiate(cfg.compute) as compute, store.replace(cfg.out) as folder:
        folder.mkdir()
        cuts = compute.each(lambda sequence: cut(cfg, sequence, folder), sequences)
        lines = list(ProgressBar().track(cuts, len(sequences), "cut"))
    return "; ".join(lines)


def cut(cfg: DictConfig, sequence: str, folder: Path) -> str:
    """The submaps of one sequence."""
    scans = store.read(Path(cfg.scans, f"{sequence}.zarr"), schemas.Scans)
    submaps = instantiate(cfg.submap).cut(scans, Progress())
    left_out = "".join(
        f", {count} left out ({reason})" for reason, count in sorted(submaps.left_out.items())
    )
    if not len(submaps.scans):
        raise ArtifactError(
            f"{scans.path}: no submap of submap.step_m={cfg.submap.step_m} can be cut from "
            f"it{left_out}"
        )
    store.write(folder / f"{sequence}.zarr", submaps)
    return f"{sequence}: {len(submaps.scans)} submaps of {len(submaps.used)} scans{left_out}"


if __name__ == "__main__":
    main()
