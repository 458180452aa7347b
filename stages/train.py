"""Views and places of the training sequences → a model, or one that was trained before, grown."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
from hydra.core.hydra_config import HydraConfig
from hydra.utils import instantiate
from numpy.typing import NDArray
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.matching import growth
from pipeline.matching.places import Places
from pipeline.matching.ranking import Model, Rows, joined_places
from pipeline.running.provenance import fingerprint
from stages import ProgressBar, stage, within_budget


@stage("train")
def main(cfg: DictConfig) -> str:
    sequences = [f"{sequence}.zarr" for sequence in cfg.sequences.split()]
    views_of_sequences = [Rows.read(Path(cfg.views, name)) for name in sequences]
    labels = [store.read(Path(cfg.labels, name), schemas.Labels) for name in sequences]
    cfg = within_budget(cfg, HydraConfig.get().overrides.task if HydraConfig.initialized() else ())
    method = instantiate(cfg.method)
    share = float(cfg.budget.share)
    views = Rows.joined(views_of_sequences)
    places = joined_places([day_labels.load("places") for day_labels in labels])
    checkpoint_key = fingerprint(
        method, share, views.images[:], places, views.world_T_anchor, type(method), str(cfg["from"])
    )
    progress = ProgressBar(share, Path(cfg.checkpoints, f"{checkpoint_key}.safetensors"))
    if not cfg["from"]:
        learned = method.learn(views, places, progress)
    else:
        learned, (_, places) = growth.grown(
            method,
            store.read_model(cfg["from"]),
            views_of_sequences,
            Places.of(labels[0]),
            progress,
        )
    model = {"image_shape": np.array(views.images.shape[1:]), **learned}
    store.write_model(
        cfg.out, model, {"_target_": cfg.method._target_, **asdict(method), "budget": share}
    )
    progress.done()
    return _summary(model, places, share)


def _summary(model: Model, places: NDArray[np.int64], share: float) -> str:
    """The stage's line: how many views and places, and which round of a training is kept."""
    rounds = next((len(array) for name, array in model.items() if name.startswith("curves/")), 0)
    trained = (
        f"{share:g} of the full training, round {int(model.get('best_epoch', rounds - 1)) + 1} of "
        f"{rounds} kept"
    )
    return (
        f"{len(places)} views of {places.max() + 1} places, "
        f"{trained if rounds else 'nothing to train'}"
    )


if __name__ == "__main__":
    main()
