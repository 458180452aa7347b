"""A model and a sequence's views → a ranking of places for each query, and when to reject one as unseen."""

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.matching.ranking import Rows
from stages import stage


@stage("localize")
def main(cfg: DictConfig) -> str:
    model, rejection = store.read_model(cfg.model), instantiate(cfg.rejection)
    ranking = rejection.order(instantiate(cfg.method).localize(model, Rows.read(cfg.views), cfg.k))
    thresholds = rejection.thresholds(model, ranking.kinds)
    chosen = {"kinds": ranking.kinds, "thresholds": thresholds, "wanted_precision": rejection.wanted_precision}
    with store.write(cfg.out, schemas.RANKINGS, **chosen) as out:
        for name in schemas.RANKINGS.columns:
            out.put(name, getattr(ranking, name))
    rejected = int((ranking.novelty[:, 0].astype(float) >= thresholds[0]).sum())
    return f"{cfg.sequence}: {ranking.places.shape[1]} places for each of {len(ranking.places)} queries, {rejected} rejected"


if __name__ == "__main__":
    main()
