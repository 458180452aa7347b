"""Views and places of the training sequence → a model."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from hydra.core.hydra_config import HydraConfig
from hydra.utils import instantiate
from omegaconf import DictConfig, OmegaConf

from pipeline import schemas, store
from pipeline.matching.ranking import Rows, joined_places
from pipeline.running.provenance import fingerprint
from stages import ProgressBar, stage


@stage("train")
def main(cfg: DictConfig) -> str:
    sequences = [f"{sequence}.zarr" for sequence in cfg.sequences.split()]
    views = Rows.joined([Rows.read(Path(cfg.views, name)) for name in sequences])
    places = joined_places([store.read(Path(cfg.labels, name), schemas.LABELS).load("places") for name in sequences])
    cfg = within_budget(cfg, HydraConfig.get().overrides.task if HydraConfig.initialized() else ())
    method, share = instantiate(cfg.method), float(cfg.budget.share)
    key = fingerprint(method, share, views.images[:], places, views.world_T_anchor, type(method))
    progress = ProgressBar(share, Path(cfg.checkpoints, f"{key}.safetensors"))
    model = {"image_shape": np.array(views.images.shape[1:]), **method.learn(views, places, progress)}
    store.write_model(cfg.out, model, {"_target_": cfg.method._target_, **asdict(method), "budget": share})
    progress.done()
    rounds = next((len(array) for name, array in model.items() if name.startswith("curves/")), 0)
    trained = f"{share:g} of the full training, round {int(model.get('best_epoch', rounds - 1)) + 1} of {rounds} kept"
    return f"{len(places)} views of {places.max() + 1} places, {trained if rounds else 'nothing to train'}"


def within_budget(cfg: DictConfig, overrides: Sequence[str]) -> DictConfig:
    """The configuration with its method's words of conf/budget in `method` and `budget`; what `overrides` set stays as it is."""
    explicit = {override.lstrip("+").partition("=")[0] for override in overrides}
    words = {"share": cfg.budget.share, **cfg.budget.get(cfg.method._target_.split(".")[-2], {})}
    share = cfg.budget.share if "budget.share" in explicit else words["share"]
    given = {key: value for key, value in words.items() if key != "share" and f"method.{key}" not in explicit}
    return OmegaConf.create({**cfg, "method": {**cfg.method, **given}, "budget": {"share": share}})


if __name__ == "__main__":
    main()
