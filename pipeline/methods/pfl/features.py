"""Place feature learning: codes of bird-views, learned by an adversarial game and matched in
sequences (METHODS 5).

Yin et al., IROS 2018. A reference place has the codes of eight headings, a query has one, of
heading 0; the distance is the least of the eight.
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
from pipeline.methods.pfl.adversarial import RIGHT, SETTLED, Health, Training, health, pixels
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
"""Rounds of a training, and bounds on the iterations of each; after a round the networks are judged
and kept."""
ENCODER = "net/encoder."
DECODER = "net/decoder."
AT_ONCE = 256
"""Images encoded at a time."""
HELD = 256
PICTURES = 16
"""Held-out images used at most for judging a round, and stored as pictures."""


@dataclass(frozen=True)
class FeatureMethod(Training, ABC):
    """Codes and matching, shared by the variants of place feature learning."""

    reference_headings: ReferenceHeadings = 8
    """Headings of a place whose codes are kept: the paper's eight bins, or fewer to see what they
    are worth."""

    @abstractmethod
    def terms(self) -> Objective:
        """The loss terms of this variant, and their weights."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Train on all headings of the rows that are not held out; the database has all rows."""
        images = _images(views)
        database = Database.learned(views, places)
        is_held_out = self.held_out(views)
        judged_images = images[
            is_held_out if is_held_out.any() else ~is_held_out
        ]  # a path too short for blocks is judged on its trained rows
        with loop.reproducible(self.threads):
            torch.manual_seed(self.seed)
            objective = self.terms()
            game = Game(
                Encoder(self.width, code=self.code),
                Decoder(self.width, code=self.code),
                JointDiscriminator(self.width, code=self.code),
                ImageDiscriminator(self.width, head=objective.head) if objective.image else None,
                objective,
            ).to(device())
            judge = self._judge(
                game, images, views, database, _spread(judged_images.reshape(-1, SIDE, SIDE), HELD)
            )
            data = images[~is_held_out].reshape(-1, SIDE, SIDE)
            total = max(1, round(self.epochs * progress.budget * len(data) / self.batch))
            iterations = min(
                total, max(LEAST_ITERATIONS, min(MOST_ITERATIONS, -(-total // ROUNDS)))
            )
            if not self.epochs:  # one round of none, judged once its batch norms are settled
                total = iterations = SETTLED
            curves = self.play(game, data, judge, round(total / iterations), iterations, progress)
            nets = loop.arrays(game.encoder, ENCODER) | loop.arrays(game.decoder, DECODER)
            columns = {f"curves/{name}": column for name, column in curves.items()}
            model = {**nets, **columns, "best_epoch": np.array(self.kept_round(curves))}
            seen = _spread(judged_images[:, 0], PICTURES)
            pictures = {
                "pictures/seen": seen,
                "pictures/reconstructed": self.reconstructed(model, seen),
            }
            codes = self._codes(model, images)
        evidence = self.evidence(database, views, _difference(codes))
        return {**model, **pictures, "codes": codes, **database.arrays(), **evidence.arrays()}

    def _judge(
        self,
        game: Game,
        images: NDArray[np.uint8],
        views: Rows,
        database: Database,
        sample: NDArray[np.uint8],
    ) -> Callable[[Game], Health]:
        """Make the judge of a round: held-out rows known, and health on images (n, 64, 64)."""
        codes = _batched(game.encoder)
        held_out = pixels(sample, device())
        headings = reference_headings(images.shape[1], self.reference_headings)

        def difference(rows: NDArray[np.int64], queries: NDArray[np.int64]) -> NDArray[np.float32]:
            reference = codes(images[rows, headings].reshape(-1, SIDE, SIDE)).reshape(
                len(rows), -1, self.code
            )
            return nearest_heading(reference, codes(images[queries, 0]))[0]

        @torch.inference_mode()
        def judge(game: Game) -> Health:
            right = self.evidence(database, views, difference).right
            return {RIGHT: float(right.mean()), **health(game.encoder, game.decoder, held_out)}

        return judge

    def localizer(self, model: Model) -> Localizer:
        """Rank reference rows by the nearest heading to the query, over a sequence."""
        describe = self.describer(model)
        database = Database.of(model)
        codes = model["codes"]

        def rank(views: Rows, k: int) -> Ranking:
            differences, bins = nearest_heading(codes, describe(views))
            return self.ranked(database, differences, k, bins * np.float32(360 / codes.shape[1]))

        return rank

    def describer(self, model: Model) -> Callable[[Rows], NDArray[np.float32]]:
        """The encoder alone: the images at the robot's heading to codes (n, code)."""
        encode = self.encoder(model)
        return lambda views: encode(_images(views, 0))

    def moved(self, model: Model, views: Rows, places: NDArray[np.int64]) -> Model:
        """The same networks with another database.

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

    def grow(
        self, model: Model, known_set: TrainingSet, new_set: TrainingSet, progress: Progress
    ) -> Model:
        """The networks stay as they are; the database holds the new codes too."""
        all_data = TrainingSet.joined([known_set, new_set])
        grown = self.moved(model, *all_data)
        return {
            **grown,
            **self.evidence(
                Database.of(grown), all_data.views, _difference(grown["codes"])
            ).arrays(),
        }

    def encoder(self, model: Model) -> Callable[[NDArray[np.uint8]], NDArray[np.float32]]:
        """A function from images (n, 64, 64) to codes (n, code).

        Each code is independent of the others in the batch.
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
        return ((decoded[:, 0] + 1) * 127.5).round().astype(np.uint8)

    def _codes(self, model: Model, images: NDArray[np.uint8]) -> NDArray[np.float16]:
        """Codes (n, heading, code) of the reference headings."""
        reference = images[:, reference_headings(images.shape[1], self.reference_headings)]
        codes = self.encoder(model)(reference.reshape(-1, SIDE, SIDE))
        return codes.reshape(*reference.shape[:2], -1).astype(np.float16)

    def _folded(self, model: Model) -> Encoder:
        return folded(_trained(Encoder, model, ENCODER), loop.dtype(device(), self.precision))


def _difference(
    codes: NDArray[np.float16],
) -> Callable[[NDArray[np.int64], NDArray[np.int64]], NDArray[np.float32]]:
    """The differences of rows of codes (n, heading, code) from queries at the robot's own."""

    def difference(rows: NDArray[np.int64], queries: NDArray[np.int64]) -> NDArray[np.float32]:
        return nearest_heading(codes[rows], codes[queries, 0].astype(np.float32))[0]

    return difference


def _trained(kind: Callable[[int, int, int], loop.Net], model: Model, prefix: str) -> loop.Net:
    """A model's encoder or decoder in evaluation mode: batch norms use their running statistics.

    Width, channels and code length are the model's, whatever the method's settings are.
    """
    width, channels = model[f"{ENCODER}halvings.0.0.weight"].shape[:2]
    net = kind(width, channels, len(model[f"{ENCODER}dense.bias"]))
    loop.fill(net, model, prefix)
    return net.eval().to(device())


def _batched(net: Callable[[Tensor], Tensor]) -> Callable[[NDArray[np.uint8]], NDArray[np.float32]]:
    """A network's answers to images (n, 64, 64), AT_ONCE at a time; a GPU is waited for once."""

    @torch.inference_mode()
    def answer(images: NDArray[np.uint8]) -> NDArray[np.float32]:
        starts = range(0, max(len(images), 1), AT_ONCE)
        data = torch.as_tensor(images).to(device())
        return (
            torch.cat([net(pixels(data[i : i + AT_ONCE], device())).float() for i in starts])
            .cpu()
            .numpy()
        )

    return answer


def _spread(images: NDArray[np.uint8], most: int) -> NDArray[np.uint8]:
    """At most `most` of the images, evenly spread."""
    rows = np.linspace(0, len(images) - 1, min(most, len(images))).astype(int)
    return np.asarray(images[rows])


def _images(views: Rows, headings: int | slice = slice(None)) -> NDArray[np.uint8]:
    """Bird-views (n, heading, 64, 64), or (n, 64, 64) at one heading."""
    shape = views.images.shape
    if len(shape) != 4 or shape[1] % 2 or shape[2:] != (SIDE, SIDE):
        raise InputError(
            f"views of shape {shape[1:]}: expected bird-views, an even number of headings × {SIDE} "
            f"× {SIDE}"
        )
    return np.asarray(views.images[:, headings]).astype(np.uint8, copy=False)
