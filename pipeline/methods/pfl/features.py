"""Place feature learning: codes of bird-views, learned by an adversarial game and matched in
sequences (METHODS 5).

It is the common part of PFL and AFL (Yin et al., IROS 2018), which differ in their loss terms.
`learn` trains an encoder on the bird-views of the training sequence (`adversarial`), and stores the
codes of each view at eight headings. `localizer` encodes a query's view at the robot's own heading,
computes the distance to the nearest of the eight codes of each training row, and ranks the rows by
sequences of these distances.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.matching.database import PREFIX as DATABASE
from pipeline.matching.database import Database
from pipeline.matching.headings import ReferenceHeadings, nearest_heading, reference_headings
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows, TrainingSet
from pipeline.methods.pfl.adversarial import (
    ACCURACY,
    SETTLING_BATCHES,
    AdversarialMethod,
    Health,
    measure_health,
    to_pixels,
)
from pipeline.methods.pfl.bigan import (
    SIDE,
    Decoder,
    Encoder,
    ImageDiscriminator,
    JointDiscriminator,
    folded,
)
from pipeline.methods.pfl.game import Game, Objective
from pipeline.networks import loop
from pipeline.networks.lenet import device

ROUNDS = 8
LEAST_ITERATIONS = 10
MOST_ITERATIONS = 2000
"""A training has ROUNDS rounds, unless a round would have fewer or more iterations than these
bounds. After each round the networks are judged and a checkpoint is written."""
ENCODER = "net/encoder."
DECODER = "net/decoder."
"""Prefixes of the networks' weights in a model."""
AT_ONCE = 256
"""The number of images that are encoded at a time."""
JUDGED_IMAGES = 256
"""The largest number of validation images by which a round is judged."""
PICTURES = 16
"""The largest number of validation images that a model stores, with their reconstructions."""


@dataclass(frozen=True)
class FeatureMethod(AdversarialMethod, ABC):
    """Learns codes and matches them; PFL and AFL add their loss terms."""

    reference_headings: ReferenceHeadings = 8
    """The number of headings of a training row whose codes are stored: eight as in the paper, or
    fewer to measure their effect."""

    @abstractmethod
    def terms(self) -> Objective:
        """The loss terms of this variant, and their weights."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Train on all headings of the rows outside validation blocks, then encode all rows."""
        images = _images(views)
        database = Database.learned(views, places)
        is_validation = self.validation(views)
        # A path too short for validation blocks is judged on its trained rows.
        is_judged = is_validation if is_validation.any() else ~is_validation
        judged_images = images[is_judged]
        with loop.reproducible(self.threads):
            # Train in rounds.
            torch.manual_seed(self.seed)
            game = self._game()
            sample = _spread(judged_images.reshape(-1, SIDE, SIDE), JUDGED_IMAGES)
            judge = self._judge(game, images, views, database, sample)
            trained_images = images[~is_validation].reshape(-1, SIDE, SIDE)
            rounds, iterations = self._rounds(len(trained_images), progress.budget)
            curves = self.play(game, trained_images, judge, rounds, iterations, progress)
            # The model: both networks, the curves, some pictures for the report, and the codes.
            nets = loop.arrays(game.encoder, ENCODER) | loop.arrays(game.decoder, DECODER)
            columns = {f"curves/{name}": column for name, column in curves.items()}
            model = {**nets, **columns, "best_epoch": np.array(self.kept_round(curves))}
            shown_images = _spread(judged_images[:, 0], PICTURES)
            pictures = {
                "pictures/seen": shown_images,
                "pictures/reconstructed": self.reconstructed(model, shown_images),
            }
            codes = self._codes(model, images)
        evidence = self.evidence(database, views, _difference(codes))
        return {**model, **pictures, "codes": codes, **database.arrays(), **evidence.arrays()}

    def _game(self) -> Game:
        """The networks before training, on the device."""
        objective = self.terms()
        return Game(
            Encoder(self.width, code=self.code),
            Decoder(self.width, code=self.code),
            JointDiscriminator(self.width, code=self.code),
            ImageDiscriminator(self.width, head=objective.head) if objective.image else None,
            objective,
        ).to(device())

    def _rounds(self, image_count: int, budget: float) -> tuple[int, int]:
        """The numbers of rounds and of iterations per round, for a share `budget` of the epochs."""
        if not self.epochs:  # one round without training, to settle the batch norms and to judge
            return 1, SETTLING_BATCHES
        total = max(1, round(self.epochs * budget * image_count / self.batch))
        # A share of 1 / ROUNDS, rounded up, within the bounds.
        iterations = max(LEAST_ITERATIONS, min(MOST_ITERATIONS, -(-total // ROUNDS)))
        iterations = min(total, iterations)
        return round(total / iterations), iterations

    def _judge(
        self,
        game: Game,
        images: NDArray[np.uint8],
        views: Rows,
        database: Database,
        sample: NDArray[np.uint8],
    ) -> Callable[[Game], Health]:
        """Make a round's judge: recognised validation rows, and health on `sample` (n, 64, 64)."""
        encode = _batched(game.encoder)
        validation = to_pixels(sample, device())
        headings = reference_headings(images.shape[1], self.reference_headings)

        def difference(rows: NDArray[np.int64], queries: NDArray[np.int64]) -> NDArray[np.float32]:
            """The differences of rows from queries, by the codes of the present encoder."""
            codes = encode(images[rows, headings].reshape(-1, SIDE, SIDE))
            reference = codes.reshape(len(rows), -1, self.code)
            distances, _ = nearest_heading(reference, encode(images[queries, 0]))
            return distances

        @torch.inference_mode()
        def judge(game: Game) -> Health:
            right = self.evidence(database, views, difference).right
            return {
                ACCURACY: float(right.mean()),
                **measure_health(game.encoder, game.decoder, validation),
            }

        return judge

    def localizer(self, model: Model) -> Localizer:
        """Rank training rows by sequences; views that are passed together are one sequence."""
        describe = self.describer(model)
        database = Database.of(model)
        codes = model["codes"]

        def rank(views: Rows, k: int) -> Ranking:
            differences, headings = nearest_heading(codes, describe(views))
            heading_deg = headings * np.float32(360 / codes.shape[1])
            return self.ranked(database, differences, k, heading_deg)

        return rank

    def describer(self, model: Model) -> Callable[[Rows], NDArray[np.float32]]:
        """A function from views to the codes (n, code) of their images at the robot's heading."""
        encode = self.encoder(model)
        return lambda views: encode(_images(views, 0))

    def moved(self, model: Model, views: Rows, places: NDArray[np.int64]) -> Model:
        """The model with the same networks, but these views and places as its database.

        The evidence stays that of the training sequence.
        """
        networks = {
            name: array for name, array in model.items() if not name.startswith(("codes", DATABASE))
        }
        return {
            **networks,
            "codes": self._codes(model, _images(views)),
            **Database.learned(views, places).arrays(),
        }

    def extend(
        self, model: Model, known_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """Add the new views to the database; the networks stay as they are."""
        all_data = TrainingSet.joined([known_set, new_set])
        all_views, all_places = all_data
        joined_model = self.moved(model, all_views, all_places)
        difference = _difference(joined_model["codes"])
        evidence = self.evidence(Database.of(joined_model), all_views, difference)
        return {**joined_model, **evidence.arrays()}

    def encoder(self, model: Model) -> Callable[[NDArray[np.uint8]], NDArray[np.float32]]:
        """A function from images (n, 64, 64) to codes (n, code).

        A code does not depend on the other images of the call.
        """
        encode = _batched(self._folded(model))

        def codes(images: NDArray[np.uint8]) -> NDArray[np.float32]:
            with loop.reproducible(self.threads):
                return encode(images)

        return codes

    def reconstructed(self, model: Model, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Images (n, 64, 64) decoded from the codes of images (n, 64, 64)."""
        encoder = self._folded(model)
        decoder = _trained(Decoder, model, DECODER)
        with loop.reproducible(self.threads):
            decoded = _batched(lambda images: decoder(encoder(images).float()))(images)
        # From [−1, 1] back to 0 … 255.
        return ((decoded[:, 0] + 1) * 127.5).round().astype(np.uint8)

    def _codes(self, model: Model, images: NDArray[np.uint8]) -> NDArray[np.float16]:
        """Codes (n, heading, code) of the reference headings."""
        reference = images[:, reference_headings(images.shape[1], self.reference_headings)]
        codes = self.encoder(model)(reference.reshape(-1, SIDE, SIDE))
        return codes.reshape(*reference.shape[:2], -1).astype(np.float16)

    def _folded(self, model: Model) -> Encoder:
        """A model's encoder with folded batch norms, with weights of the type of `precision`."""
        return folded(_trained(Encoder, model, ENCODER), loop.dtype(device(), self.precision))


def _difference(
    codes: NDArray[np.float16],
) -> Callable[[NDArray[np.int64], NDArray[np.int64]], NDArray[np.float32]]:
    """A function for the differences of rows of codes (n, heading, code) from each other."""

    def difference(rows: NDArray[np.int64], queries: NDArray[np.int64]) -> NDArray[np.float32]:
        query_codes = codes[queries, 0].astype(np.float32)
        distances, _ = nearest_heading(codes[rows], query_codes)
        return distances

    return difference


def _trained(
    network_class: Callable[[int, int, int], loop.Net], model: Model, prefix: str
) -> loop.Net:
    """A model's encoder or decoder, of the model's own width and code length, ready to answer."""
    width, channels = model[f"{ENCODER}halvings.0.0.weight"].shape[:2]
    net = network_class(width, channels, len(model[f"{ENCODER}dense.bias"]))
    loop.fill(net, model, prefix)
    return net.eval().to(device())


def _batched(net: Callable[[Tensor], Tensor]) -> Callable[[NDArray[np.uint8]], NDArray[np.float32]]:
    """A function for a network's answers to images (n, 64, 64), AT_ONCE at a time."""

    @torch.inference_mode()
    def answer(images: NDArray[np.uint8]) -> NDArray[np.float32]:
        data = torch.as_tensor(images).to(device())
        answers = []
        for start in range(0, max(len(images), 1), AT_ONCE):
            answers.append(net(to_pixels(data[start : start + AT_ONCE], device())).float())
        return torch.cat(answers).cpu().numpy()

    return answer


def _spread(images: NDArray[np.uint8], largest_count: int) -> NDArray[np.uint8]:
    """Some of the images, `largest_count` at most, evenly spread over all."""
    rows = np.linspace(0, len(images) - 1, min(largest_count, len(images))).astype(int)
    return np.asarray(images[rows])


def _images(views: Rows, headings: int | slice = slice(None)) -> NDArray[np.uint8]:
    """The images of bird-views (n, heading, 64, 64), or (n, 64, 64) at one heading."""
    shape = views.images.shape
    if len(shape) != 4 or shape[1] % 2 or shape[2:] != (SIDE, SIDE):
        raise InputError(
            f"views of shape {shape[1:]}: expected bird-views, an even number of headings × {SIDE} "
            f"× {SIDE}"
        )
    return np.asarray(views.images[:, headings]).astype(np.uint8, copy=False)
