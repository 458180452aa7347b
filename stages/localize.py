"""A model and the test sequences' views → a ranking of places for each query, and when to reject one as unseen."""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.frames import wrapped_deg, yaw
from pipeline.matching.ranking import Localizer, Model, Rows, joined
from stages import ProgressBar, stage


@stage("localize")
def main(cfg: DictConfig) -> str:
    sequences = cfg.sequences.split()
    with instantiate(cfg.compute).apart() as compute, store.replace(cfg.out) as folder:
        folder.mkdir()
        lines = compute.each(Answers(cfg, folder), sequences)
        return "; ".join(ProgressBar().track(lines, len(sequences), "localize"))


@dataclass
class Answers:
    """The rankings of test sequences, one at a time; each process reads the model once."""

    cfg: DictConfig
    folder: Path
    ready: tuple[Model, Localizer] | None = None

    def __call__(self, sequence: str) -> str:
        if not self.ready:
            model = store.read_model(self.cfg.model)
            self.ready = model, instantiate(self.cfg.method).localizer(model)
        return rank(self.cfg, sequence, *self.ready, self.folder)


def rank(cfg: DictConfig, sequence: str, model: Model, localizer: Localizer, folder: Path) -> str:
    """The rankings of one sequence: as driven, then of each altered case, each case asked by itself."""
    name, alterations = f"{sequence}.zarr", (cfg.alterations or "").split()
    cases = Rows.queries(Path(cfg.views, name), [Path(cfg.altered, alteration, name) for alteration in alterations])
    rejection, (driven, *_) = instantiate(cfg.rejection), cases.values()
    ranking = joined([rejection.order(localizer(rows, cfg.k).checked(len(rows.stamps_ns))) for rows in cases.values()])
    left_rad = np.concatenate([yaw(rows.world_T_anchor) - yaw(driven.world_T_anchor) for rows in cases.values()])
    thresholds = rejection.thresholds(model, ranking.kinds)
    attrs = {"cases": [asdict(case) for case in cases], "wanted_precision": rejection.wanted_precision}
    with store.write(folder / name, schemas.RANKINGS, kinds=ranking.kinds, thresholds=thresholds, **attrs) as out:
        out.put("turned_deg", wrapped_deg(np.rad2deg(left_rad)))
        for column in schemas.RANKINGS.columns.keys() - {"turned_deg"}:
            out.put(column, getattr(ranking, column))
    rejected = int((ranking.novelty[: len(driven.stamps_ns), 0].astype(float) >= thresholds[0]).sum())
    altered, said = f" in {len(cases)} cases" if len(cases) > 1 else "", rejection.summary(model, ranking.kinds[0], rejected)
    return f"{sequence}: {ranking.places.shape[1]} places for {len(driven.stamps_ns)} queries{altered}, {said}"


if __name__ == "__main__":
    main()
