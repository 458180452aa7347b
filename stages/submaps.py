"""Scans → submaps: one every `step_m` of path, each around an anchor pose."""

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.errors import ArtifactError
from stages import Bars, stage


@stage("submaps")
def main(cfg: DictConfig) -> str:
    scans = store.read(cfg.scans, schemas.SCANS)
    made = instantiate(cfg.submap).cut(scans, Bars())
    left_out = "".join(f", {count} left out ({reason})" for reason, count in sorted(made.left_out.items()))
    if not len(made.scans):
        raise ArtifactError(f"{cfg.scans}: no submap of submap.step_m={cfg.submap.step_m} can be cut from it{left_out}")
    with store.write(cfg.out, schemas.SUBMAPS, layout=made.layout, left_out=dict(made.left_out)) as out:
        for name in ("first", "scans", "ground_m", "used"):
            out.put(name, getattr(made, name))
        out.put("stamps_ns", scans.load("stamps_ns")[made.scans])
        out.put("world_T_anchor", scans.load("world_T_scan")[made.scans])
    return f"{cfg.sequence}: {len(made.scans)} submaps of {len(made.used)} scans{left_out}"


if __name__ == "__main__":
    main()
