"""PointNetVLAD: places recognised by a learned descriptor of the cloud around the sensor (Uy and
Lee, CVPR 2018; METHODS 3.2)."""

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
from pipeline.core.settings import Count, NotNegative, Positive, Seed, Whole
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
"""A training has so many rounds, each of at least and at most so many steps; the authors' have 700.

Between rounds the descriptors are computed anew, to judge the network by the held-out blocks and to
find the hardest negatives.
"""
WARM_UP = (
    0.25  # share of the training with random negatives alone: the authors' first 5 of 20 epochs
)
AT_ONCE = 16_384
"""Points described at a time: few enough for a processor's cache."""


@dataclass(frozen=True)
class PointNetVlad(DescriptorMethod):
    """The authors' network, loss and mining, learned from the training sequence: not their
    pretrained network."""

    view: str = "cloud"
    weights: str = ""
    """A file to start from, or with `epochs` 0 to use as it is: a model of this method, or
    safetensors under its names, with or without net/. Of a TensorFlow checkpoint, every kernel but
    the centres is transposed to (outputs, inputs)."""
    epochs: Whole = 20
    batch: Count = 2
    """Queries a step; each brings its positives, its negatives and one cloud more."""
    positives: Count = 2
    negatives: Count = 18
    hard_negatives: Whole = 10
    positive_m: Positive = 10.0
    """Clouds no further apart show the same place."""
    negative_m: float = 50.0
    """Clouds further apart show different ones."""
    margin: NotNegative = 0.5
    margin_star: NotNegative = 0.2
    train_points: Count = 4096
    """Random points of each cloud while training."""
    points: Count = 4096
    """Of each cloud that make its descriptor, the first ones: a cloud comes in random order.

    The model keeps this number.
    """
    turn_deg: NotNegative = 0.0
    """Each training cloud is turned by up to this to either side; the authors' is 0, and 90 an
    option of theirs."""
    learning_rate: Positive = 0.00005
    schedule: loop.Schedule = "one_cycle"
    """The authors' is stepped."""
    batch_norm_momentum: Positive = 0.1
    """Weight of a new batch in the running statistics; the authors' .001 would not forget the first
    ones in a short training."""
    precision: loop.Precision = "auto"
    threads: Count = 2
    """Fixed, since the order of sums follows from it and the weights from that."""
    seed: Seed = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.epochs == 0 and not self.weights:
            setting = f"method.epochs={self.epochs}"
            raise ConfigError(
                f"{setting}: expected 1 or more, or 0 with method.weights to use them as they are"
            )
        if not self.positive_m < self.negative_m:
            raise ConfigError(
                f"method.negative_m={self.negative_m}: expected more than "
                f"positive_m={self.positive_m}"
            )

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Train on the training sequence's clouds (n, point, xyz) outside held-out blocks.

        The database has all.
        """
        clouds = _clouds(views)
        database = Database.learned(views, places)
        is_held_out = holdout.blocks(
            views.world_T_anchor, places, self.held_out_every_m, self.held_out_length_m
        )
        with loop.reproducible(self.threads):
            torch.manual_seed(self.seed)
            net = Describer(momentum=self.batch_norm_momentum).to(device())
            if self.weights:
                load(net, Path(self.weights))
            curves = (
                self._train(net, clouds, database, is_held_out, progress) if self.epochs else {}
            )
            descriptors = self._describer(net)(clouds[:, : self.points])
        evidence = database.evidence(euclidean(descriptors), views, self)
        return {
            **loop.arrays(net),
            "descriptors": descriptors,
            "points": np.array(self.points),
            **database.arrays(),
            **evidence.arrays(),
            **curves,
        }

    def grow(
        self, model: Model, known_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """The network stays as it is; the database describes the new clouds too."""
        all_data = TrainingSet.joined([known_set, new_set])
        clouds = _clouds(new_set.views)[:, : int(model["points"])]
        with loop.reproducible(self.threads):
            descriptors = np.concatenate([model["descriptors"], self._trained(model)(clouds)])
        database = Database.learned(*all_data)
        evidence = database.evidence(euclidean(descriptors), all_data.views, self)
        return {**model, "descriptors": descriptors, **database.arrays(), **evidence.arrays()}

    def _trained(self, model: Model) -> Callable[[NDArray[np.float16]], NDArray[np.float32]]:
        with torch.device("meta"):
            net = Describer()
        loop.fill(net, model, assign=True)
        return self._describer(net.to(device()))

    def localizer(self, model: Model) -> Localizer:
        """The nearest training clouds by Euclidean distance between descriptors."""
        describe = self.describer(model)
        database = Database.of(model)
        descriptors = model["descriptors"]

        def rank(views: Rows, k: int) -> Ranking:
            return database.nearest(descriptors, describe(views), k, self.distinct_places)

        return rank

    def describer(self, model: Model) -> Callable[[Rows], NDArray[np.float32]]:
        """The network alone: clouds (n, point, xyz) to descriptors (n, 256)."""
        describe = self._trained(model)
        points = int(model["points"])

        def described(views: Rows) -> NDArray[np.float32]:
            with loop.reproducible(self.threads):
                return describe(_clouds(views)[:, :points])

        return described

    def _train(
        self,
        net: Describer,
        clouds: NDArray[np.float16],
        database: Database,
        is_held_out: NDArray[np.bool_],
        progress: Progress,
    ) -> dict[str, NDArray[Any]]:
        """Leave the weights of the best round in the network; returns its number and the curves."""
        rows = np.flatnonzero(~is_held_out)
        judged_rows = (
            np.flatnonzero(is_held_out) if is_held_out.any() else rows
        )  # a path too short for blocks is judged on what it trained
        tuples = Tuples(
            database.xy_m[rows],
            self.positive_m,
            self.negative_m,
            self.positives,
            self.negatives,
            self.hard_negatives,
        )
        queries = tuples.queries()
        total = max(1, round(self.epochs * progress.budget * len(queries) / self.batch))
        steps = min(total, max(LEAST_STEPS, min(MOST_STEPS, -(-total // ROUNDS))))
        rounds = round(total / steps)
        gap_m = cdist(database.xy_m[judged_rows], database.xy_m[rows])
        part = clouds[:, : self.train_points]
        latest: list[NDArray[np.float32]] = []

        def batches(order: torch.Generator) -> Iterator[Tensor]:
            """A round's batches of clouds (query · tuple, point, xyz)."""
            rng = np.random.default_rng(order.initial_seed())
            steps_done = net.steps()
            descriptors = None
            if steps_done >= WARM_UP * rounds * steps:
                descriptors = (latest[-1] if latest else self._describer(net)(part))[rows]
            shuffled = np.concatenate(
                [rng.permutation(queries) for _ in range(-(-steps * self.batch // len(queries)))]
            )
            for batch_queries in shuffled[: steps * self.batch].reshape(steps, self.batch):
                chosen_rows = rows[
                    np.concatenate(
                        [tuples.draw(query, rng, descriptors) for query in batch_queries]
                    )
                ]
                yield self._points(clouds, chosen_rows, rng)

        def step(answer: Callable[[Tensor], Tensor], batch: Tensor) -> tuple[Tensor, Tensor, int]:
            descriptors = answer(batch).view(self.batch, 2 + self.positives + self.negatives, -1)
            return *lazy_quadruplet(
                descriptors, self.positives, self.margin, self.margin_star
            ), self.batch

        def judge(net: Describer) -> tuple[float, float]:
            """Loss and accuracy of held-out rows against all the trained ones.

            The loss's first term, and whether the nearest row is of the right place.
            """
            latest[:] = [self._describer(net)(part)]
            distances = cdist(latest[0][judged_rows], latest[0][rows], "sqeuclidean")
            distances[judged_rows[:, None] == rows] = np.inf
            nearest_positive = np.where(gap_m <= self.positive_m, distances, np.inf).min(axis=1)
            nearest_negative = np.where(gap_m > self.positive_m, distances, np.inf).min(axis=1)
            losses = np.clip(self.margin + nearest_positive - nearest_negative, 0, self.margin + 4)
            right = database.places[rows[distances.argmin(axis=1)]] == database.places[judged_rows]
            return float(losses.mean()), float(right.mean())

        return loop.fit(
            net,
            batches,
            judge,
            epochs=rounds,
            steps=steps,
            learning_rate=self.learning_rate,
            schedule=self.schedule,
            precision=self.precision,
            seed=self.seed,
            progress=progress,
            step=step,
            fused=True,
        )

    def _points(
        self, clouds: NDArray[np.float16], rows: NDArray[np.int64], rng: np.random.Generator
    ) -> Tensor:
        """Training's clouds (row, train_points, xyz), each turned as `turn_deg` allows."""
        points = rng.choice(clouds.shape[1], min(self.train_points, clouds.shape[1]), replace=False)
        batch = torch.from_numpy(clouds[rows[:, None], points]).float()
        if self.turn_deg:
            turn = torch.from_numpy(
                np.deg2rad(rng.uniform(-self.turn_deg, self.turn_deg, (len(rows), 1)))
            ).float()
            x = batch[..., 0].clone()
            y = batch[..., 1].clone()
            batch[..., 0] = turn.cos() * x - turn.sin() * y
            batch[..., 1] = turn.sin() * x + turn.cos() * y
        return batch.to(device())

    def _describer(self, net: Describer) -> Callable[[NDArray[np.float16]], NDArray[np.float32]]:
        """A function from clouds (n, point, xyz) to descriptors (n, 256)."""
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


def _clouds(views: Rows) -> NDArray[np.float16]:
    """All clouds (n, point, xyz) of a view."""
    clouds = np.asarray(views.images[:])
    if clouds.ndim != 3 or clouds.shape[1] < 1 or clouds.shape[2] != 3:
        raise InputError(f"views of shape {clouds.shape[1:]}: expected clouds, points × 3")
    return clouds.astype(np.float16, copy=False)
