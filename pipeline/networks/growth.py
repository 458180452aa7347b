"""Growing a classifier: further days are learned without forgetting the earlier ones (METHODS
11.1)."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pipeline.matching.ranking import Model, TrainingSet
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from pipeline.networks.lenet import device
from pipeline.networks.training import Training, blocks
from pipeline.running.progress import Progress

SOFTNESS = 2.0
"""Temperature at which the answers of two networks are compared (Hinton et al., 2015)."""


def grown(
    method: Classifier, model: Model, known: TrainingSet, new: TrainingSet, progress: Progress
) -> Model:
    """The model of all days: the network goes on, on the new views and, of each known place, those
    of the highest loss.

    Where the earlier network is right, its answers are kept (Li and Hoiem, Learning without
    Forgetting, PAMI 2018). The evidence is that of the new days' held-out blocks beside what the
    model has: on the earlier blocks its network has since been trained.
    """
    data = TrainingSet.joined([known, new])
    fresh = len(known) + np.arange(len(new))
    held = np.concatenate([np.zeros(len(known), bool), blocks(method, new)])
    with loop.reproducible(method.threads):
        torch.manual_seed(method.seed)
        before = method.filled(model)
        net = method.network(int(data.places.max()) + 1, *data.views.images.shape[1:])
        training = Training(
            method, data, held, net.to(device()), progress, partial(distilled, method, before)
        )
        features, rows = method.embed_training(
            before, training.heights[fresh], new.views, torch.arange(len(new))
        )
        net.load_state_dict(widened(before, features, new.places[rows.numpy()]))
        seen = method.predict(before, training.heights[: len(known)]).logits
        shown = np.concatenate([hardest(seen, known.places, method.rehearsed), fresh])
        curves = training.fit(shown[~held[shown]], method.grown)
        chosen = training.evidence(np.flatnonzero(~held), model)
        if method.refit:
            training.fit(shown, method.refit * method.grown, "refit")
        return training.model(*chosen, np.arange(len(data)), curves)


def hardest(logits: Tensor, places: NDArray[np.int64], each: int) -> NDArray[np.int64]:
    """Rows (m,), of each place so many of those whose logits (n, places) give the highest
    cross-entropy."""
    losses = nn.functional.cross_entropy(logits, torch.from_numpy(places), reduction="none").numpy()
    order = np.lexsort((-losses, places))
    rank = np.arange(len(order)) - np.searchsorted(places[order], places[order])
    return np.sort(order[rank < each])


def widened(before: nn.Module, features: Tensor, places: NDArray[np.int64]) -> dict[str, Tensor]:
    """An earlier network's weights, its last layer with a row more for each new place of features
    (n, 64), of length 1.

    A new place's row is the mean of its features, as long as the others are (Qi et al., Imprinted
    Weights, CVPR 2018).
    """
    weights = {name: value.clone() for name, value in before.state_dict().items()}
    weight, bias = (f"{before.last}.{name}" for name in ("weight", "bias"))
    rows = weights[weight]
    known = len(weights[weight])
    new = [
        features[torch.from_numpy(places == place)].mean(0)
        for place in range(known, int(places.max()) + 1)
    ]
    if new:
        length = rows.norm(dim=1).mean()
        weights[weight] = torch.cat(
            [rows, nn.functional.normalize(torch.stack(new)).to(rows) * length]
        )
        weights[bias] = torch.cat([weights[bias], weights[bias].mean().expand(len(new))])
    return weights


def distilled(
    method: Classifier, before: nn.Module, answer: Callable[..., Tensor], batch: Any
) -> tuple[Tensor, Tensor, int]:
    """A method's step, whose loss counts also how far the answers are from an earlier network's,
    where that is right."""
    answers: list[Tensor] = []

    def listened(*inputs: Any) -> Tensor:
        answers.append(answer(*inputs))
        return answers[-1]

    loss, right, count = method.step(listened, batch)
    if method.distilled:
        images, classes, *_ = batch
        with torch.no_grad(), loop.autocast(device(), method.precision):
            earlier = method.whole(before(images)).float()
        places = earlier.shape[-1]
        both = (method.whole(answers[0]).float()[..., :places], earlier)
        own, wanted = ((one / SOFTNESS).flatten(1).log_softmax(1) for one in both)
        apart = nn.functional.kl_div(own, wanted, reduction="none", log_target=True).sum(1)
        knew = wanted.argmax(1) % places == classes
        loss = loss + method.distilled * SOFTNESS**2 * (apart * knew).mean()
    return loss, right, count
