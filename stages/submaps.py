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
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        done = instantiate(cfg.compute).each(lambda sequence: cut(cfg, sequence, folder), sequences)
        told = list(ProgressBar().track(done, len(sequences), "cut"))
    return "; ".join(told)


def cut(cfg: DictConfig, sequence: str, folder: Path) -> str:
    """The submaps of one sequence."""
    scans = store.read(Path(cfg.scans, f"{sequence}.zarr"), schemas.SCANS)
    made = instantiate(cfg.submap).cut(scans, Progress())
    left_out = "".join(f", {count} left out ({reason})" for reason, count in sorted(made.left_out.items()))
    if not len(made.scans):
        raise ArtifactError(f"{scans.path}: no submap of submap.step_m={cfg.submap.step_m} can be cut from it{left_out}")
    with store.write(folder / f"{sequence}.zarr", schemas.SUBMAPS, layout=made.layout, left_out=dict(made.left_out)) as out:
        for name in ("first", "scans", "ground_m", "used"):
            out.put(name, getattr(made, name))
        out.put("stamps_ns", scans.load("stamps_ns")[made.scans])
        out.put("world_T_anchor", scans.load("world_T_scan")[made.scans])
    return f"{sequence}: {len(made.scans)} submaps of {len(made.used)} scans{left_out}"


if __name__ == "__main__":
    main()
