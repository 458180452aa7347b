"""Place feature learning: codes of bird-views, learned by an adversarial game and matched in sequences (METHODS 5).

Yin et al., IROS 2018. A reference place has the codes of eight headings, a query has one; the distance is the least of the eight.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from pipeline.errors import ConfigError, InputError
from pipeline.matching.database import PREFIX as DATABASE
from pipeline.matching.database import Database
from pipeline.matching.headings import nearest_heading
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.sequences import SequenceMethod
from pipeline.methods.pfl import coding
from pipeline.methods.pfl.adversarial import RIGHT, best_round, health, pixels, play
from pipeline.methods.pfl.bigan import SIDE, Decoder, Encoder, ImageDiscriminator, JointDiscriminator
from pipeline.methods.pfl.game import Game, Objective
from pipeline.networks import loop
from pipeline.networks.lenet import device
from pipeline.running.progress import Progress
from pipeline.running.settings import positive

ROUNDS, LEAST_ITERATIONS, MOST_ITERATIONS = 8, 10, 2000
"""Rounds of a training, and bounds on the iterations of each; after a round the networks are judged and kept."""
REFERENCE = slice(0, None, 2)
"""Headings of a view whose codes are a reference place's: 0°, 45°, … (METHODS 5.4); a query is heading 0."""
HELD, PICTURES = 256, 16
"""Held-out images used at most for judging a round, and stored as pictures."""


@dataclass(frozen=True)
class FeatureMethod(SequenceMethod, ABC):
    """Training, codes and matching, shared by the variants of place feature learning."""

    view: str = "birdview"
    contrast_rows: int = 30
    width: int = 64
    """Filters of the first convolution; every hidden layer scales with it. A model is used at its own width."""
    code: int = 512
    """Numbers in a code: 1 KB as they are stored."""
    epochs: int = 30
    """Passes over all headings of the training rows. Neither the paper nor its code says how many; BiGAN's authors make 400 over
    MNIST's 50,000 images, and 30 over the 120,000 of an NCLT drive are 56,000 iterations."""
    batch: int = 64
    learning_rate: float = 0.0002
    schedule: loop.Schedule = "constant"
    """The authors' is constant; a short training needs the rate to fall at its end, and then `learning_rate` is the peak."""
    beta1: float = 0.5
    generator_steps: int = 4
    """Of the generators in an iteration, on the same batch; the discriminators and the cycles have one."""
    precision: Literal["auto", "bf16", "f32"] = "auto"
    threads: int = 2
    """Fixed, since the order of sums follows from it and the weights from that."""
    seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        positive("method", width=self.width, code=self.code, epochs=self.epochs, learning_rate=self.learning_rate)
        positive("method", generator_steps=self.generator_steps, threads=self.threads)
        if self.batch < 2:
            raise ConfigError(f"method.batch={self.batch}: expected 2 or more, for the batch norms")
        if not 0 <= self.beta1 < 1:
            raise ConfigError(f"method.beta1={self.beta1}: expected 0 or more, and less than 1")

    @abstractmethod
    def terms(self) -> Objective:
        """The loss terms of this variant, and their weights."""

    def learn(self, views: Rows, places: NDArray[np.int64], progress: Progress) -> Model:
        """Train on all headings of the rows that are not held out; the database has all rows."""
        images, database = _images(views), Database.learned(views, places)
        held = self.held_out(views)
        shown = np.flatnonzero(held if held.any() else ~held)  # a path too short for blocks is judged on its trained rows
        with loop.reproducible(self.threads):
            torch.manual_seed(self.seed)
            game = self._game()
            curves = self._train(game, images, views, database, progress)
            model = {
                **{f"net/{part}.{name}": value.cpu().contiguous().numpy() for part in ("encoder", "decoder")
                   for name, value in getattr(game, part).state_dict().items()},
                **{f"curves/{name}": column for name, column in curves.items()},
                "best_epoch": np.array(best_round(curves)),
            }  # fmt: skip
            seen = images[shown[np.linspace(0, len(shown) - 1, min(PICTURES, len(shown))).astype(int)], 0]
            pictures = {"pictures/seen": seen, "pictures/reconstructed": self.reconstructed(model, seen)}
            codes = self._codes(model, images)

        def difference(rows: NDArray[np.int64], queries: NDArray[np.int64]) -> NDArray[np.float32]:
            return nearest_heading(codes[rows], codes[queries, 0].astype(np.float32))[0]

        evidence = self.evidence(database, views, difference)
        return {**model, **pictures, "codes": codes, **database.arrays(), **evidence.arrays()}

    def localizer(self, model: Model) -> Localizer:
        """The reference rows whose nearest heading is nearest to the query, over a sequence of them."""
        encode, database, codes = self.encoder(model), Database.of(model), model["codes"]

        def rank(views: Rows, k: int) -> Ranking:
            differences, bins = nearest_heading(codes, encode(_images(views, 0)))
            return self.ranked(database, differences, k, bins * np.float32(360 / codes.shape[1]))

        return rank

    def moved(self, model: Model, views: Rows, places: NDArray[np.int64]) -> Model:
        """The same networks with another database; the evidence stays that of the training sequence."""
        kept = {name: array for name, array in model.items() if not name.startswith(("codes", DATABASE))}
        return {**kept, "codes": self._codes(model, _images(views)), **Database.learned(views, places).arrays()}

    def encoder(self, model: Model) -> Callable[[NDArray[np.uint8]], NDArray[np.float32]]:
        """A function from images (n, 64, 64) to codes (n, code), each independent of the others in the batch."""
        encode = coding.batched(coding.encoder(model, self.precision))

        def codes(images: NDArray[np.uint8]) -> NDArray[np.float32]:
            with loop.reproducible(self.threads):
                return encode(images)

        return codes

    def reconstructed(self, model: Model, images: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Images (n, 64, 64) decoded from the codes of images (n, 64, 64)."""
        encoder, decoder = coding.encoder(model, self.precision), coding.decoder(model)
        with loop.reproducible(self.threads):
            decoded = coding.batched(lambda images: decoder(encoder(images).float()))(images)
        return ((decoded[:, 0] + 1) * 127.5).round().astype(np.uint8)

    def _codes(self, model: Model, images: NDArray[np.uint8]) -> NDArray[np.float16]:
        """Of the reference headings (n, 8, code)."""
        reference = images[:, REFERENCE]
        codes = self.encoder(model)(reference.reshape(-1, SIDE, SIDE))
        return codes.reshape(*reference.shape[:2], -1).astype(np.float16)

    def _game(self) -> Game:
        objective = self.terms()
        return Game(
            Encoder(self.width, code=self.code),
            Decoder(self.width, code=self.code),
            JointDiscriminator(self.width, code=self.code),
            ImageDiscriminator(self.width, head=objective.head) if objective.image else None,
            objective,
        ).to(device())

    def _train(
        self, game: Game, images: NDArray[np.uint8], views: Rows, database: Database, progress: Progress
    ) -> dict[str, NDArray[np.float64]]:
        where, held = device(), self.held_out(views)
        data = images[~held].reshape(-1, SIDE, SIDE)
        total = max(1, round(self.epochs * progress.budget * len(data) / self.batch))
        iterations = min(total, max(LEAST_ITERATIONS, min(MOST_ITERATIONS, -(-total // ROUNDS))))
        shown = images[held if held.any() else ~held].reshape(-1, SIDE, SIDE)
        sample = pixels(shown[np.linspace(0, len(shown) - 1, min(HELD, len(shown))).astype(int)], where)

        codes = coding.batched(game.encoder)

        @torch.inference_mode()
        def judge(game: Game) -> dict[str, float]:
            def difference(rows: NDArray[np.int64], queries: NDArray[np.int64]) -> NDArray[np.float32]:
                reference = codes(images[rows, REFERENCE].reshape(-1, SIDE, SIDE)).reshape(len(rows), -1, self.code)
                return nearest_heading(reference, codes(images[queries, 0]))[0]

            right = self.evidence(database, views, difference).right
            return {RIGHT: float(right.mean()), **health(game.encoder, game.decoder, sample)}

        return play(
            game,
            data,
            judge,
            code=self.code,
            rounds=round(total / iterations),
            iterations=iterations,
            batch=self.batch,
            learning_rate=self.learning_rate,
            schedule=self.schedule,
            beta1=self.beta1,
            generator_steps=self.generator_steps,
            precision=self.precision,
            seed=self.seed,
            progress=progress,
        )


def _images(views: Rows, headings: int | slice = slice(None)) -> NDArray[np.uint8]:
    """Bird-views (n, heading, 64, 64), or (n, 64, 64) at one heading."""
    shape = views.images.shape
    if len(shape) != 4 or shape[1] % 2 or shape[2:] != (SIDE, SIDE):
        raise InputError(f"views of shape {shape[1:]}: expected bird-views, an even number of headings × {SIDE} × {SIDE}")
    return np.asarray(views.images[:, headings]).astype(np.uint8, copy=False)
