"""Grows a classifier: learns further days without forgetting the earlier ones (METHODS 11.1)."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pipeline.core.progress import Progress
from pipeline.matching.ranking import Model, TrainingSet
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from pipeline.networks.lenet import device
from pipeline.networks.training import Training, blocks

SOFTNESS = 2.0
"""Temperature at which the answers of two networks are compared (Hinton et al., 2015)."""


def grown(
    method: Classifier,
    model: Model,
    known_set: TrainingSet,
    new_set: TrainingSet,
    progress: Progress,
) -> Model:
    """The model of all days, its network trained on with new views and hard known ones.

    Of each known place the views of the highest loss are shown again. Where the earlier network is
    right, its answers are kept (Li and Hoiem, Learning without Forgetting, PAMI 2018). The evidence
    is that of the new days' held-out blocks beside what the model has: on the earlier blocks its
    network has since been trained.
    """
    data = TrainingSet.joined([known_set, new_set])
    fresh = len(known_set) + np.arange(len(new_set))
    is_held_out = np.concatenate([np.zeros(len(known_set), bool), blocks(method, new_set)])
    with loop.reproducible(method.threads):
        torch.manual_seed(method.seed)
        before = method.filled(model)
        net = method.network(int(data.places.max()) + 1, *data.views.images.shape[1:])
        training = Training(
            method,
            data,
            is_held_out,
            net.to(device()),
            progress,
            partial(distilled, method, before),
        )
        features, rows = method.embed_training(
            before, training.heights[fresh], new_set.views, torch.arange(len(new_set))
        )
        net.load_state_dict(widened(before, features, new_set.places[rows.numpy()]))
        seen = method.predict(before, training.heights[: len(known_set)]).logits
        rehearsed_rows = np.concatenate([hardest(seen, known_set.places, method.rehearsed), fresh])
        curves = training.fit(rehearsed_rows[~is_held_out[rehearsed_rows]], method.grown)
        softness, evidence = training.evidence(np.flatnonzero(~is_held_out), model)
        if method.refit:
            training.fit(rehearsed_rows, method.refit * method.grown, "refit")
        return training.model(softness, evidence, np.arange(len(data)), curves)


def hardest(logits: Tensor, places: NDArray[np.int64], each: int) -> NDArray[np.int64]:
    """Rows (m,) of the `each` views of each place with the highest cross-entropy.

    By logits (n, places).
    """
    losses = nn.functional.cross_entropy(logits, torch.from_numpy(places), reduction="none").numpy()
    order = np.lexsort((-losses, places))
    rank = np.arange(len(order)) - np.searchsorted(places[order], places[order])
    return np.sort(order[rank < each])


def widened(before: nn.Module, features: Tensor, places: NDArray[np.int64]) -> dict[str, Tensor]:
    """An earlier network's weights, with a row of the last layer for each new place.

    `features` (n, 64) are of length 1. A new place's row is the mean of its features, as long as
    the others are (Qi et al., Imprinted Weights, CVPR 2018).
    """
    weights = {name: value.clone() for name, value in before.state_dict().items()}
    weight, bias = (f"{before.last_layer}.{name}" for name in ("weight", "bias"))
    rows = weights[weight]
    n_known = len(weights[weight])
    new_rows = [
        features[torch.from_numpy(places == place)].mean(0)
        for place in range(n_known, int(places.max()) + 1)
    ]
    if new_rows:
        length = rows.norm(dim=1).mean()
        weights[weight] = torch.cat(
            [rows, nn.functional.normalize(torch.stack(new_rows)).to(rows) * length]
        )
        weights[bias] = torch.cat([weights[bias], weights[bias].mean().expand(len(new_rows))])
    return weights


def distilled(
    method: Classifier, before: nn.Module, answer: Callable[..., Tensor], batch: Any
) -> tuple[Tensor, Tensor, int]:
    """A method's step whose loss adds the distance to an earlier network's answers.

    Only where that network is right.
    """
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
        logits = method.whole(answers[0]).float()[..., :places]
        log_chances = (logits / SOFTNESS).flatten(1).log_softmax(1)
        earlier_log_chances = (earlier / SOFTNESS).flatten(1).log_softmax(1)
        divergence = nn.functional.kl_div(
            log_chances, earlier_log_chances, reduction="none", log_target=True
        ).sum(1)
        knew = earlier_log_chances.argmax(1) % places == classes
        loss = loss + method.distilled * SOFTNESS**2 * (divergence * knew).mean()
    return loss, right, count
