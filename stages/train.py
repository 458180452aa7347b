"""Stage `train`: a method learns the views of the training sequences and their places.

It writes a model. If an earlier model of the first sequence is given, this model learns the later
sequences incrementally; otherwise a new model learns all sequences.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.core import schemas, store
from pipeline.core.building import target_of
from pipeline.core.settings import Names, Positive
from pipeline.matching import incremental
from pipeline.matching.places import Places
from pipeline.matching.ranking import Model, Rows, joined_places
from pipeline.running.provenance import fingerprint
from stages import ProgressBar, stage, within_budget


@dataclass(frozen=True)
class Budget:
    """The settings of a file of conf/budget for the method that is trained."""

    share: Positive
    """The share of the method's full training to run."""


@dataclass(frozen=True, kw_only=True)
class Settings:
    """The stage's settings: the keys of conf/train.yaml."""

    method: Any
    budget: Budget
    sequences: Names
    from_: Path | None = None  # `from` in the yaml, a reserved word here
    """A model of the first sequence, which learns the later sequences incrementally; None trains a
    new model."""
    views: Path
    """Folder with the views of each sequence."""
    labels: Path
    """Folder with the place of each view, by sequence."""
    out: Path
    """Where the model is written."""
    checkpoints: Path
    """Folder for the checkpoints of an unfinished training."""


# Before `main` runs, `within_budget` changes the method's settings by the budget.
@stage("train", within_budget)
def main(settings: Settings) -> str:
    names = [f"{sequence}.zarr" for sequence in settings.sequences]
    views_of_sequences = [Rows.read(settings.views / name) for name in names]
    labels_by_day = [store.read(settings.labels / name, schemas.Labels) for name in names]
    method = settings.method
    share = float(settings.budget.share)
    views = Rows.joined(views_of_sequences)
    places_by_day = [labels.load("places") for labels in labels_by_day]
    places = joined_places(places_by_day)
    # All that a checkpoint's weights depend on. With another key, training starts again.
    checkpoint_key = fingerprint(
        method,
        share,
        views.images[:],
        places,
        views.world_T_anchor,
        type(method),
        str(settings.from_),
    )
    # A method reads from `progress` the share of its full training to run.
    progress = ProgressBar(share, settings.checkpoints / f"{checkpoint_key}.safetensors")
    if not settings.from_:
        weights = method.learn(views, places, progress)
    else:
        weights, learned_set = incremental.extended(
            method,
            store.read_model(settings.from_),
            views_of_sequences,
            Places.of(labels_by_day[0]),
            progress,
        )
        places = learned_set.places  # of the updated model, for the summary
    model = {"image_shape": np.array(views.images.shape[1:]), **weights}
    recipe = {"_target_": target_of(method), **asdict(method), "budget": share}
    store.write_model(settings.out, model, recipe)
    progress.done()
    return _summary(model, places, share)


def _summary(model: Model, places: NDArray[np.int64], share: float) -> str:
    """A line on the model: the numbers of views and places, and the epoch that was kept."""
    learned = f"{len(places)} views of {places.max() + 1} places"
    curves = [array for name, array in model.items() if name.startswith("curves/")]
    epochs = len(curves[0]) if curves else 0
    if not epochs:
        return f"{learned}, nothing to train"
    # The model's `best_epoch` counts from 0; for a method that trains in rounds it is a round.
    kept_epoch = int(model.get("best_epoch", epochs - 1)) + 1
    return f"{learned}, {share:g} of the full training, epoch {kept_epoch} of {epochs} kept"


if __name__ == "__main__":
    main()
