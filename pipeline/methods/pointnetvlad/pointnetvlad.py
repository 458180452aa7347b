"""PointNetVLAD: places recognised by a learned descriptor of the cloud around the sensor (Uy and
Lee, CVPR 2018; METHODS 3.2).

The network, `netvlad.Describer`, maps a cloud to a descriptor. It is trained so that clouds of the
same place have near descriptors, and clouds far apart have distant descriptors (`quadruplet`).
`learn` trains it, and describes the training sequence's clouds. `localizer` describes the query's
cloud and ranks the training clouds by the distance of their descriptors.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial.distance import cdist
from torch import Tensor

from pipeline.core.errors import ConfigError, InputError
from pipeline.core.progress import Progress
from pipeline.core.settings import Count, NotNegative, Positive, Seed, Whole, checked
from pipeline.matching import holdout
from pipeline.matching.database import Database, DescriptorMethod, euclidean
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows, TrainingSet
from pipeline.methods.pointnetvlad.netvlad import Describer, folded
from pipeline.methods.pointnetvlad.quadruplet import Tuples, lazy_quadruplet
from pipeline.methods.pointnetvlad.weights import load
from pipeline.networks import loop
from pipeline.networks.lenet import device

ROUNDS = 4
LEAST_STEPS = 10
MOST_STEPS = 700
"""A training has ROUNDS rounds, unless a round would have fewer or more steps than these bounds;
the authors' rounds have 700 steps.

Between rounds the descriptors are computed again, to judge the network by the validation blocks and
to find the hardest negatives.
"""
WARM_UP = 0.25
"""The first share of the training, which has only random negatives: 5 of 20 epochs in the authors'
code."""
AT_ONCE = 16_384
"""The number of points that are described at a time: few enough for a processor's cache."""


@dataclass(frozen=True)
@checked("method")
class PointNetVlad(DescriptorMethod):
    """The authors' network, loss and choice of negatives, trained on the training sequence.

    `weights` can name the authors' pretrained network.
    """

    view: str = "cloud"
    weights: str = ""
    """A file of weights to start from, or to use as they are if `epochs` is 0: see
    `pointnetvlad.weights`."""
    epochs: Whole = 20
    batch: Count = 2
    """The number of queries in a step; each has its positives, its negatives and one more cloud."""
    positives: Count = 2
    negatives: Count = 18
    hard_negatives: Whole = 10
    """How many of the negatives are the most similar to the query, after the warm-up."""
    positive_m: Positive = 10.0
    """Clouds at most this far apart show the same place."""
    negative_m: float = 50.0
    """Clouds farther apart than this show different places."""
    margin: NotNegative = 0.5
    margin_star: NotNegative = 0.2
    """The margins of the loss (`quadruplet`)."""
    train_points: Count = 4096
    """The number of random points of each cloud that training uses."""
    points: Count = 4096
    """The number of points of each cloud that its descriptor is computed from: the first points,
    since a cloud is in random order. The model stores this number."""
    turn_deg: NotNegative = 0.0
    """Each training cloud is turned by a random angle up to this, to either side; the authors use
    0, and their code has 90 as an option."""
    learning_rate: Positive = 0.00005
    schedule: loop.Schedule = "one_cycle"
    """The authors' schedule is stepped."""
    batch_norm_momentum: Positive = 0.1
    """Weight of a new batch in the batch norms' running statistics. With the authors' .001 a short
    training would not forget the first batches."""
    precision: loop.Precision = "auto"
    threads: Count = 2
    """The number of threads is a setting, since the order of sums and so the weights depend on it.
    """
    seed: Seed = 0

    def __post_init__(self) -> None:
        if self.epochs == 0 and not self.weights:
            raise ConfigError(
                f"method.epochs={self.epochs}: expected 1 or more, or 0 with method.weights to use "
                "them as they are"
            )
        if not self.positive_m < self.negative_m:
            raise ConfigError(
                f"method.negative_m={self.negative_m}: expected more than "
                f"positive_m={self.positive_m}"
            )

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Train on the training sequence's clouds (n, point, xyz) outside validation blocks.

        Afterwards all clouds are described, for the database.
        """
        clouds = _clouds(views)
        database = Database.learned(views, places)
        is_validation = holdout.blocks(
            views.world_T_anchor, places, self.validation_every_m, self.validation_length_m
        )
        with loop.reproducible(self.threads):
            torch.manual_seed(self.seed)
            net = Describer(momentum=self.batch_norm_momentum).to(device())
            if self.weights:
                load(net, Path(self.weights))
            curves: dict[str, NDArray[Any]] = {}
            if self.epochs:
                training = _Training(self, net, clouds, database, is_validation, progress.budget)
                curves = training.fit(progress)
            descriptors = self.cloud_describer(net)(clouds[:, : self.points])
        evidence = database.evidence(euclidean(descriptors), views, self)
        return {
            **loop.arrays(net),
            "descriptors": descriptors,
            "points": np.array(self.points),
            **database.arrays(),
            **evidence.arrays(),
            **curves,
        }

    def extend(
        self, model: Model, known_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """Add the new clouds to the database; the network stays as it is."""
        all_data = TrainingSet.joined([known_set, new_set])
        clouds = _clouds(new_set.views)[:, : int(model["points"])]
        with loop.reproducible(self.threads):
            descriptors = np.concatenate(
                [model["descriptors"], self._model_describer(model)(clouds)]
            )
        all_views, all_places = all_data
        database = Database.learned(all_views, all_places)
        evidence = database.evidence(euclidean(descriptors), all_views, self)
        return {**model, "descriptors": descriptors, **database.arrays(), **evidence.arrays()}

    def _model_describer(
        self, model: Model
    ) -> Callable[[NDArray[np.float16]], NDArray[np.float32]]:
        """A function from clouds (n, point, xyz) to descriptors (n, 256), by a model's network."""
        with torch.device("meta"):
            net = Describer()
        loop.fill(net, model, assign=True)
        return self.cloud_describer(net.to(device()))

    def localizer(self, model: Model) -> Localizer:
        """Rank training clouds by the Euclidean distance of their descriptors from the query's."""
        describe = self.describer(model)
        database = Database.of(model)
        descriptors = model["descriptors"]

        def rank(views: Rows, k: int) -> Ranking:
            return database.nearest(descriptors, describe(views), k, self.distinct_places)

        return rank

    def describer(self, model: Model) -> Callable[[Rows], NDArray[np.float32]]:
        """A function from views to descriptors (n, 256)."""
        describe = self._model_describer(model)
        points = int(model["points"])

        def describe_views(views: Rows) -> NDArray[np.float32]:
            with loop.reproducible(self.threads):
                return describe(_clouds(views)[:, :points])

        return describe_views

    def cloud_describer(
        self, net: Describer
    ) -> Callable[[NDArray[np.float16]], NDArray[np.float32]]:
        """A function from clouds (n, point, xyz) to descriptors (n, 256), by a network."""
        torch_device = next(net.parameters()).device
        fast = folded(net, loop.dtype(torch_device, self.precision))

        @torch.inference_mode()
        def describe(clouds: NDArray[np.float16]) -> NDArray[np.float32]:
            at_once = max(1, AT_ONCE // clouds.shape[1])
            with loop.autocast(torch_device, self.precision):
                parts = [
                    fast(part.to(torch_device).float())
                    for part in torch.split(torch.from_numpy(clouds), at_once)
                ]
            return torch.cat(parts).cpu().numpy()

        return describe


class _Training:
    """The training of a network in rounds: draws batches, computes the loss, judges rounds."""

    def __init__(
        self,
        method: PointNetVlad,
        net: Describer,
        clouds: NDArray[np.float16],
        database: Database,
        is_validation: NDArray[np.bool_],
        budget: float,
    ) -> None:
        """Train on clouds (n, point, xyz) for a share `budget` of all epochs."""
        self.method = method
        self.net = net
        self.clouds = clouds
        self.train_clouds = clouds[:, : method.train_points]
        self.database = database
        self.rows = np.flatnonzero(~is_validation)
        # A path too short for validation blocks is judged on its trained rows.
        self.judged_rows = np.flatnonzero(is_validation) if is_validation.any() else self.rows
        self.distances_m = cdist(database.xy_m[self.judged_rows], database.xy_m[self.rows])
        self.tuples = Tuples(
            xy_m=database.xy_m[self.rows],
            positive_m=method.positive_m,
            negative_m=method.negative_m,
            positives=method.positives,
            negatives=method.negatives,
            hard=method.hard_negatives,
        )
        self.queries = self.tuples.queries()
        total = max(1, round(method.epochs * budget * len(self.queries) / method.batch))
        # A share of 1 / ROUNDS, rounded up, within the bounds.
        self.steps = min(total, max(LEAST_STEPS, min(MOST_STEPS, -(-total // ROUNDS))))
        self.rounds = round(total / self.steps)
        self.descriptors: NDArray[np.float32] | None = None
        """(n, 256) the descriptors of all clouds, from the last call of `judge`."""

    def fit(self, progress: Progress) -> dict[str, NDArray[Any]]:
        """Train, and leave the weights of the best round in the network.

        Returns the number of the best round and the curves, like `loop.fit`.
        """
        return loop.fit(
            self.net,
            self.batches,
            self.judge,
            epochs=self.rounds,
            steps=self.steps,
            learning_rate=self.method.learning_rate,
            schedule=self.method.schedule,
            precision=self.method.precision,
            seed=self.method.seed,
            progress=progress,
            step=self.step,
            fused=True,
        )

    def batches(self, order: torch.Generator) -> Iterator[Tensor]:
        """A round's batches of clouds (query · tuple, point, xyz), after the warm-up with hard
        negatives.

        Every query is used once, in random order, before a query is used again.
        """
        rng = np.random.default_rng(order.initial_seed())
        descriptors = None
        if self.net.steps() >= WARM_UP * self.rounds * self.steps:
            if self.descriptors is None:  # after an interruption
                self.descriptors = self.method.cloud_describer(self.net)(self.train_clouds)
            descriptors = self.descriptors[self.rows]
        query_count = self.steps * self.method.batch
        passes = -(-query_count // len(self.queries))  # rounded up
        shuffled = np.concatenate([rng.permutation(self.queries) for _ in range(passes)])
        for queries in shuffled[:query_count].reshape(self.steps, self.method.batch):
            drawn = [self.tuples.draw(query, rng, descriptors) for query in queries]
            yield self._points(self.rows[np.concatenate(drawn)], rng)

    def _points(self, rows: NDArray[np.int64], rng: np.random.Generator) -> Tensor:
        """Random points (row, train_points, xyz) of some clouds, each cloud turned at random."""
        cloud_size = self.clouds.shape[1]
        points = rng.choice(cloud_size, min(self.method.train_points, cloud_size), replace=False)
        batch = torch.from_numpy(self.clouds[rows[:, None], points]).float()
        turn_deg = self.method.turn_deg
        if turn_deg:
            angles = np.deg2rad(rng.uniform(-turn_deg, turn_deg, (len(rows), 1)))
            turn = torch.from_numpy(angles).float()
            x = batch[..., 0].clone()
            y = batch[..., 1].clone()
            batch[..., 0] = turn.cos() * x - turn.sin() * y
            batch[..., 1] = turn.sin() * x + turn.cos() * y
        return batch.to(device())

    def step(self, answer: Callable[[Tensor], Tensor], batch: Tensor) -> tuple[Tensor, Tensor, int]:
        """The loss of a batch, the number of its right tuples, and of all its tuples."""
        method = self.method
        tuple_size = 1 + method.positives + method.negatives + 1  # the query, …, and n*
        descriptors = answer(batch).view(method.batch, tuple_size, -1)
        loss, right = lazy_quadruplet(
            descriptors, method.positives, method.margin, method.margin_star
        )
        return loss, right, method.batch

    def judge(self, net: Describer) -> tuple[float, float]:
        """Loss and accuracy of the judged rows against all trained rows.

        The loss is the first term of the training's loss. A row is right if the trained row with
        the nearest descriptor is of the same place.
        """
        margin = self.method.margin
        positive_m = self.method.positive_m
        places = self.database.places
        self.descriptors = self.method.cloud_describer(net)(self.train_clouds)
        differences = cdist(
            self.descriptors[self.judged_rows], self.descriptors[self.rows], "sqeuclidean"
        )
        differences[self.judged_rows[:, None] == self.rows] = np.inf  # a row is not its own answer
        to_positive = np.where(self.distances_m <= positive_m, differences, np.inf).min(axis=1)
        to_negative = np.where(self.distances_m > positive_m, differences, np.inf).min(axis=1)
        # Squared distances of descriptors of length 1 are at most 4. A row without a positive gets
        # the largest loss.
        losses = np.clip(margin + to_positive - to_negative, 0, margin + 4)
        nearest_rows = self.rows[differences.argmin(axis=1)]
        is_right = places[nearest_rows] == places[self.judged_rows]
        return float(losses.mean()), float(is_right.mean())


def _clouds(views: Rows) -> NDArray[np.float16]:
    """All clouds (n, point, xyz) of a view."""
    clouds = np.asarray(views.images[:])
    if clouds.ndim != 3 or clouds.shape[1] < 1 or clouds.shape[2] != 3:
        raise InputError(f"views of shape {clouds.shape[1:]}: expected clouds, points × 3")
    return clouds.astype(np.float16, copy=False)
