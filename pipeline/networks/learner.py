"""A classifier that learns the places of the training day, and further places on further days.

The steps of `learn` (METHODS 2): views with their places in, a model out.

1. Leave out validation blocks of the path, and train on the other views. Keep the epoch that
   answers most validation views right.
2. On the validation views, find the temperature, and the evidence for the threshold of rejection.
3. With `refit`, train on all views for the end of the schedule.
4. Store the weights, and the data of each view that the localizer needs.

The steps of `extend` (METHODS 11.1): a model, the views that it knows and the views of new days in,
a model of all days out.

1. Widen the network's last layer by a row for each new place (`widened`).
2. Choose the views to train on: the new views, and of each known place the views with the highest
   loss (`hardest`).
3. Train; where the earlier network is right, keep the new network near its answers (`distilled`).
4. Gather evidence from the validation blocks of the new days.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pipeline.core.progress import Progress
from pipeline.matching.ranking import Model, Rows, TrainingSet
from pipeline.networks import loop
from pipeline.networks.classifier import Classifier
from pipeline.networks.lenet import device
from pipeline.networks.training import Training, blocks

DISTILLATION_TEMPERATURE = 2.0
"""Temperature at which the answers of the two networks are compared (Hinton et al., 2015)."""


class Learner(Classifier):
    """The base of `sci` and `sci_ring`: learns places, and further days."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Train on the views of the training sequence.

        Raises ConfigError or InputError if they do not suit the network.
        """
        data = TrainingSet.joined([TrainingSet(views, places)])
        is_validation = blocks(self, data)
        trained = np.flatnonzero(~is_validation)
        if not is_validation.any():  # a path too short for blocks is judged on its trained views
            is_validation = ~is_validation
        with loop.reproducible(self.threads):
            torch.manual_seed(self.seed)
            net = self.network(int(data.places.max()) + 1, *data.views.images.shape[1:])
            training = Training(
                method=self,
                data=data,
                is_validation=is_validation,
                net=net.to(device()),
                progress=progress,
                step=self.step,
            )
            curves = training.fit(trained, 1.0, judge=training.judge)
            temperature, evidence = training.evidence(trained, None)
            if self.refit:
                trained = np.arange(len(data))
                training.fit(trained, self.refit, "refit")
            return training.model(temperature, evidence, trained, curves)

    def extend(
        self, model: Model, known_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """Continue training with the views of further days.

        The evidence is the model's own, joined with the evidence of the new days' validation
        blocks. The earlier blocks cannot be validation queries again, since the network may have
        been trained on them since. Raises InputError if views or places do not continue the
        model's.
        """
        data = TrainingSet.joined([known_set, new_set])
        new_rows = len(known_set) + np.arange(len(new_set))
        is_new_validation = blocks(self, new_set)  # whether each new view is in a validation block
        is_validation = np.concatenate([np.zeros(len(known_set), bool), is_new_validation])
        with loop.reproducible(self.threads):
            torch.manual_seed(self.seed)
            earlier_net = self.filled(model)
            net = self.network(int(data.places.max()) + 1, *data.views.images.shape[1:])
            training = Training(
                method=self,
                data=data,
                is_validation=is_validation,
                net=net.to(device()),
                progress=progress,
                step=partial(distilled, self, earlier_net),
            )
            # Features of the new views by the earlier network, and the row of the view of each.
            features, feature_rows = self.embed_training(
                earlier_net, training.heights[new_rows], new_set.views, torch.arange(len(new_set))
            )
            feature_places = new_set.places[feature_rows.numpy()]
            net.load_state_dict(widened(earlier_net, features, feature_places))
            known_logits = self.predict(earlier_net, training.heights[: len(known_set)]).logits
            replayed_rows = hardest(known_logits, known_set.places, self.replayed)
            trained_rows = np.concatenate([replayed_rows, new_rows])
            curves = training.fit(trained_rows[~is_validation[trained_rows]], self.incremental)
            # The queries are the validation views; they are matched against the other views.
            matched_rows = np.flatnonzero(~is_validation)
            temperature, evidence = training.evidence(matched_rows, model)
            if self.refit:
                training.fit(trained_rows, self.refit * self.incremental, "refit")
            return training.model(temperature, evidence, np.arange(len(data)), curves)


def hardest(logits: Tensor, places: NDArray[np.int64], count: int) -> NDArray[np.int64]:
    """Rows (m,) of the views with the highest cross-entropy: `count` of each place.

    `logits` (n, places) are the network's for all views.
    """
    losses = nn.functional.cross_entropy(logits, torch.from_numpy(places), reduction="none").numpy()
    order = np.lexsort((-losses, places))
    # The rank of each view within its place: its position in the order, minus its place's first.
    rank = np.arange(len(order)) - np.searchsorted(places[order], places[order])
    return np.sort(order[rank < count])


def widened(
    earlier_net: nn.Module, features: Tensor, places: NDArray[np.int64]
) -> dict[str, Tensor]:
    """An earlier network's weights, with a row of the last layer for each new place.

    A new place's row is the mean of its views' `features` (n, 64), of length 1, scaled to the mean
    length of the other rows (Qi et al., Imprinted Weights, CVPR 2018). `places` (n,) are the places
    of the views.
    """
    weights = {name: value.clone() for name, value in earlier_net.state_dict().items()}
    weight_name = f"{earlier_net.last_layer}.weight"
    bias_name = f"{earlier_net.last_layer}.bias"
    known_rows = weights[weight_name]
    known_bias = weights[bias_name]
    new_means = [
        features[torch.from_numpy(places == place)].mean(0)
        for place in range(len(known_rows), int(places.max()) + 1)
    ]
    if new_means:
        length = known_rows.norm(dim=1).mean()
        new_rows = nn.functional.normalize(torch.stack(new_means)).to(known_rows) * length
        new_bias = known_bias.mean().expand(len(new_means))
        weights[weight_name] = torch.cat([known_rows, new_rows])
        weights[bias_name] = torch.cat([known_bias, new_bias])
    return weights


def distilled(
    method: Classifier, earlier_net: nn.Module, answer: Callable[..., Tensor], batch: Any
) -> tuple[Tensor, Tensor, int]:
    """A method's step (`loop.Step`), with the distance to an earlier network's answers in its loss.

    The distance is the Kullback-Leibler divergence over the earlier places, and counts only where
    the earlier network is right (Li and Hoiem, Learning without Forgetting, PAMI 2018).
    """
    answers: list[Tensor] = []

    def recorded_answer(*inputs: Any) -> Tensor:
        answers.append(answer(*inputs))
        return answers[-1]

    loss, right, count = method.step(recorded_answer, batch)
    if not method.distilled:
        return loss, right, count
    images, places, *_ = batch
    # A network may answer for parts of an image too; `whole` takes its answers for whole images.
    with torch.no_grad(), loop.autocast(device(), method.precision):
        earlier_logits = method.whole(earlier_net(images)).float()
    # Softmax over the earlier places; for the ring over headings × places, whose index modulo the
    # number of places is the place.
    place_count = earlier_logits.shape[-1]
    logits = method.whole(answers[0]).float()[..., :place_count]
    log_probabilities = (logits / DISTILLATION_TEMPERATURE).flatten(1).log_softmax(1)
    earlier_log_probabilities = (
        (earlier_logits / DISTILLATION_TEMPERATURE).flatten(1).log_softmax(1)
    )
    divergence = nn.functional.kl_div(
        log_probabilities, earlier_log_probabilities, reduction="none", log_target=True
    ).sum(1)
    was_right = earlier_log_probabilities.argmax(1) % place_count == places
    distance = (divergence * was_right).mean()
    # The gradient shrinks with the square of the temperature, which the factor compensates (Hinton
    # et al.).
    return loss + method.distilled * DISTILLATION_TEMPERATURE**2 * distance, right, count
