"""A model and a sequence's views → a ranking of places for each query."""

from dataclasses import asdict

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.matching.ranking import Rows
from stages import stage


@stage("localize")
def main(cfg: DictConfig) -> str:
    model = store.read_model(cfg.model)
    ranking = instantiate(cfg.method).localize(model, Rows.read(cfg.views), cfg.k)
    with store.write(cfg.out, schemas.RANKINGS, threshold=float(model["threshold"])) as out:
        for name, column in asdict(ranking).items():
            out.put(name, column)
    return f"{cfg.sequence}: {ranking.places.shape[1]} places for each of {len(ranking.places)} queries"


if __name__ == "__main__":
    main()
