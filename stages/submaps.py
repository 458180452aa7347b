"""Scans → submaps: one every `step_m` of path, each around an anchor pose."""

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.errors import ArtifactError
from stages import stage


@stage("submaps")
def main(cfg: DictConfig) -> str:
    scans = store.read(cfg.scans, schemas.SCANS)
    world_T_scan = scans.load("world_T_scan")
    rows = instantiate(cfg.submap).anchors(world_T_scan)
    if not len(rows):
        raise ArtifactError(f"{cfg.scans}: the path is shorter than submap.step_m={cfg.submap.step_m}")
    with store.write(cfg.out, schemas.SUBMAPS) as out:
        out.put("scans", rows)
        out.put("stamps_ns", scans.load("stamps_ns")[rows])
        out.put("world_T_anchor", world_T_scan[rows])
    return f"{cfg.sequence}: {len(rows)} submaps of {len(world_T_scan)} scans"


if __name__ == "__main__":
    main()
