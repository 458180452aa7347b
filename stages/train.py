"""Views and places of the training sequences → a model, or an earlier one, grown by them."""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.building import target_of
from pipeline.core.settings import Names, Positive
from pipeline.matching import growth
from pipeline.matching.places import Places
from pipeline.matching.ranking import Model, Rows, joined_places
from pipeline.running.provenance import fingerprint
from stages import ProgressBar, stage, within_budget


@dataclass(frozen=True)
class Budget:
    """What a file of conf/budget says of the method that is trained."""

    share: Positive
    """Of the method's own full training."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The stage's settings: the keys of conf/train.yaml."""

    method: Any
    budget: Budget
    sequences: Names
    from_: Path | None = None
    """A model of the first of the sequences, which then learns the others one after the other."""
    views: Path
    labels: Path
    out: Path
    checkpoints: Path


@stage("train", within_budget)
def main(settings: Settings) -> str:
    names = [f"{sequence}.zarr" for sequence in settings.sequences]
    views_of_sequences = [Rows.read(settings.views / name) for name in names]
    labels = [store.read(settings.labels / name, schemas.Labels) for name in names]
    method = settings.method
    share = float(settings.budget.share)
    views = Rows.joined(views_of_sequences)
    places = joined_places([day_labels.load("places") for day_labels in labels])
    checkpoint_key = fingerprint(
        method,
        share,
        views.images[:],
        places,
        views.world_T_anchor,
        type(method),
        str(settings.from_),
    )
    progress = ProgressBar(share, settings.checkpoints / f"{checkpoint_key}.safetensors")
    if not settings.from_:
        learned = method.learn(views, places, progress)
    else:
        learned, (_, places) = growth.grown(
            method,
            store.read_model(settings.from_),
            views_of_sequences,
            Places.of(labels[0]),
            progress,
        )
    model = {"image_shape": np.array(views.images.shape[1:]), **learned}
    recipe = {"_target_": target_of(method), **asdict(method), "budget": share}
    store.write_model(settings.out, model, recipe)
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
