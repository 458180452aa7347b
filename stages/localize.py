"""A model and the test sequences' views → a ranking of places for each query, and when to reject one as unseen."""

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.matching.ranking import Localizer, Model, Rows
from stages import Bars, stage


@stage("localize")
def main(cfg: DictConfig) -> str:
    model = store.read_model(cfg.model)
    localizer = instantiate(cfg.method).localizer(model)
    sequences = cfg.sequences.split()
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        told = [ranked(cfg, one, model, localizer, folder) for one in Bars().track(sequences, len(sequences), "localize")]
    return "; ".join(told)


def ranked(cfg: DictConfig, sequence: str, model: Model, localizer: Localizer, folder: Path) -> str:
    """The rankings of one sequence."""
    rejection = instantiate(cfg.rejection)
    ranking = rejection.order(localizer(Rows.read(Path(cfg.views, f"{sequence}.zarr")), cfg.k))
    thresholds = rejection.thresholds(model, ranking.kinds)
    chosen = {"kinds": ranking.kinds, "thresholds": thresholds, "wanted_precision": rejection.wanted_precision}
    with store.write(folder / f"{sequence}.zarr", schemas.RANKINGS, **chosen) as out:
        for name in schemas.RANKINGS.columns:
            out.put(name, getattr(ranking, name))
    rejected = int((ranking.novelty[:, 0].astype(float) >= thresholds[0]).sum())
    return f"{sequence}: {ranking.places.shape[1]} places for each of {len(ranking.places)} queries, {rejected} rejected"


if __name__ == "__main__":
    main()
