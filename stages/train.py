"""Views and places of the training sequence → a model."""

from dataclasses import asdict
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.matching.ranking import Rows
from pipeline.provenance import fingerprint
from stages import Bars, stage


@stage("train")
def main(cfg: DictConfig) -> str:
    views, places = Rows.read(cfg.views), store.read(cfg.labels, schemas.LABELS).load("places")
    method = instantiate(cfg.method)
    key = fingerprint(method, cfg.budget.share, views.images[:], places, views.world_T_anchor, type(method))
    checkpoint = Path(cfg.checkpoints, f"{key}.safetensors")
    model = method.learn(views, places, Bars(budget=cfg.budget.share, checkpoint=checkpoint))
    store.write_model(cfg.out, model, {"_target_": cfg.method._target_, **asdict(method), "budget": cfg.budget.share})
    checkpoint.unlink(missing_ok=True)
    numbers = ", ".join(f"{name} {array:.4g}" for name, array in model.items() if array.ndim == 0 and "/" not in name)
    return f"{len(places)} views of {places.max() + 1} places, {cfg.budget.share:g} of the full training: {numbers}"


if __name__ == "__main__":
    main()
