"""SCI on a ring: one softmax over places × headings, so an answer has a heading too (METHODS 8).

It is our own method, in neither paper. The network is `ring.Ring`; settings, training and answers
are those of `Classifier` and `Learner`, as for SCI. It differs from SCI in the network, and in
three more ways: the loss is also computed without some sectors (`step`), the first places are
re-ranked by their return profiles (`reranked`), and the kind of novelty differs (`novelties`).
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn

from pipeline.core.frames import yaw
from pipeline.core.settings import Count, NotNegative, Share
from pipeline.matching.ranking import Model, Rows
from pipeline.matching.return_profiles import ReturnProfiles, reranked, return_profiles
from pipeline.methods.sci_ring.ring import POOLED, Ring, circular_mean_deg, neighbours
from pipeline.networks import loop
from pipeline.networks.classifier import Kinds, rolled
from pipeline.networks.evidence import Prediction
from pipeline.networks.learner import Learner
from pipeline.networks.lenet import device, to_device
from pipeline.networks.plain import HEADING_TEMPERATURE


class Batch(NamedTuple):
    """A batch of training images."""

    images: Tensor
    """(b, channels, rings, sectors) coloured images, each turned at random."""
    places: Tensor
    """(b,) the places of the images."""
    arc: int
    """The number of neighbouring sectors of the features without which the loss is computed too; 0
    for no arc."""
    headings: Tensor
    """(b,) the yaw of the images, in headings of the network."""


@dataclass(frozen=True)
class SciRing(Learner):
    """SCI with the network `Ring`.

    The columns of its view must run counter-clockwise, and their number must be a multiple of 8.
    """

    architecture = Ring
    epochs: Count = 300
    """An epoch shows each training view once, turned at random."""
    batch: Count = 32
    dropout: Share = 0.5
    worst_arc: Share = 0.5
    """The weight of the loss without the arc of sectors whose absence costs most, so that no place
    depends on a few sectors alone."""
    widest_arc: Count = 5
    """The largest number of sectors in an arc, of 24° each; each batch draws a number from 1 to
    this."""
    refit: Share = 0.3
    yaw_noise_deg: NotNegative = 0.0
    """Standard deviation of Gaussian noise on the yaw of each training view, to study how precisely
    it must be known."""

    def batches(
        self, heights: Tensor, views: Rows, places: Tensor, trained: Tensor
    ) -> tuple[loop.Batches[Batch], int]:
        """The batches of an epoch: every trained view once, shuffled and turned at random."""
        sectors = heights.shape[2]
        yaw_columns = self._yaw_columns(views, sectors).to(device())
        heights, places, trained = (part.to(device()) for part in (heights, places, trained))
        widest = min(self.widest_arc, sectors // POOLED - 1) if self.worst_arc else 0

        def epoch(order: torch.Generator) -> Iterator[Batch]:
            shuffled = trained[torch.randperm(len(trained), generator=order).to(device())]
            for rows in torch.split(shuffled, self.batch):
                if len(rows) > 1 or len(trained) == 1:  # batch norms need two images
                    turns = torch.randint(sectors, (len(rows),), generator=order)
                    turns = to_device(turns, device())
                    arc = int(torch.randint(1, widest + 1, (), generator=order)) if widest else 0
                    headings = (yaw_columns[rows] - turns) / POOLED
                    images = self.images(rolled(heights[rows], turns))
                    yield Batch(images, places[rows], arc, headings)

        return epoch, -(-len(trained) // self.batch)

    def _yaw_columns(self, views: Rows, sectors: int) -> Tensor:
        """The yaw (n,) of training views in columns, with the noise of `yaw_noise_deg`."""
        random = np.random.default_rng(self.seed)
        noise_deg = random.normal(0, self.yaw_noise_deg, len(views.world_T_anchor))
        yaw_deg = np.rad2deg(yaw(views.world_T_anchor)) + noise_deg
        return torch.from_numpy(yaw_deg * (sectors / 360)).float()

    def step(self, answer: Callable[..., Tensor], batch: Batch) -> tuple[Tensor, Tensor, int]:
        """Cross-entropy in nats over headings × places, and the number of right first places.

        The target is split linearly between the two headings nearest to the true heading. A share
        `worst_arc` of the loss is the largest loss without an arc of sectors.
        """
        logits = answer(batch.images, batch.arc).float()  # (b, 1 + arcs, heading, place)
        places = batch.places
        lower, upper, share = neighbours(batch.headings, logits.shape[2])
        image = torch.arange(len(places), device=places.device)
        lower_logits = logits[image, :, lower, places]
        upper_logits = logits[image, :, upper, places]
        true_logits = lower_logits.lerp(upper_logits, share[:, None])
        costs = logits.flatten(2).logsumexp(2) - true_logits  # (b, 1 + arcs)
        right = (logits[:, 0].logsumexp(1).argmax(1) == places).sum()
        loss = costs[:, 0].lerp(costs.amax(1), self.worst_arc).mean()
        return loss, right, len(places)

    def whole(self, logits: Tensor) -> Tensor:
        """The logits (n, heading, places) of images without a missing arc."""
        return logits[:, 0]

    @torch.inference_mode()
    def predict(self, net: Ring, heights: Tensor, left_out: Tensor | None = None) -> Prediction:
        """Logits and headings of the places, and features.

        A place's probability is the sum over its headings, and its heading is their circular mean.
        The features are interpolated at the heading of the first place.
        """
        net.eval()
        torch_device = next(net.parameters()).device
        outputs = []
        for rows in torch.split(torch.arange(len(heights)), self.batch):
            embedded = self.embedded(net, heights[rows])
            heading_logits = net.place_logits(embedded)  # (image, heading, place)
            if left_out is not None:
                is_out = left_out[rows].to(torch_device)[:, None]
                heading_logits = heading_logits.masked_fill(is_out, -torch.inf)
            logits = heading_logits.logsumexp(1)
            image = torch.arange(len(rows), device=embedded.device)
            heading_deg = circular_mean_deg((heading_logits / HEADING_TEMPERATURE).softmax(1))
            first_heading = heading_deg[image, logits.argmax(1)] * (net.headings / 360)
            lower, upper, share = neighbours(first_heading, net.headings)
            features = embedded[image, lower].lerp(embedded[image, upper], share[:, None])
            outputs.append((logits, nn.functional.normalize(features), heading_deg))
        return Prediction(*(torch.cat(parts).cpu() for parts in zip(*outputs, strict=True)))

    @torch.inference_mode()
    def embed_training(
        self, net: Ring, heights: Tensor, views: Rows, trained: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Features of every view, including validation views, turned to face +x."""
        net.eval()
        facing_x = rolled(heights, self._yaw_columns(views, heights.shape[2]).round().long())
        parts = [self.embedded(net, part)[:, 0] for part in torch.split(facing_x, self.batch)]
        return nn.functional.normalize(torch.cat(parts)).cpu(), torch.arange(len(heights))

    def remembered(
        self, images: NDArray[np.float32], views: Rows, places: NDArray[np.int64], trained: Tensor
    ) -> Model:
        """The arrays of the trained views' return profiles, in the order of their places."""
        rows = trained.numpy()[np.argsort(places[trained.numpy()], kind="stable")]
        return ReturnProfiles(
            return_profiles(images[rows]),
            places[rows],
            self._yaw_columns(views, images.shape[2]).numpy()[rows],
        ).arrays()

    def reranked(
        self, prediction: Prediction, images: NDArray[np.float32], model: Model
    ) -> Prediction:
        """The outputs, with the first places re-ranked by the agreement of their return profiles.

        A return profile is the ring of the first standing object in each sector
        (matching.return_profiles).
        """
        logits, heading_deg = reranked(
            prediction.float64_logits,
            prediction.heading_deg.numpy(),
            return_profiles(images),
            ReturnProfiles.of(model),
        )
        return prediction._replace(
            logits=torch.from_numpy(logits),
            heading_deg=torch.from_numpy(heading_deg.astype(np.float32)),
        )

    def positions(
        self, places_m: NDArray[np.float64], most_similar_m: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """World positions (n, k, 2) in metres of the answers.

        The first answer has the position of the query's most similar training view, the others have
        the mean positions of their places.
        """
        return np.concatenate([most_similar_m[:, None], places_m[:, 1:]], axis=1)

    def novelties(
        self, logits: NDArray[np.float64], temperature: float, max_cosine: NDArray[np.float64]
    ) -> Kinds:
        """The kinds of novelty; the one in use is `combined`: tempered entropy × feature distance.

        On validation blocks of two simulated worlds it reached a higher AUROC and AUC than either
        of the two alone.
        """
        kinds = super().novelties(logits, temperature, max_cosine)
        return {"combined": kinds["tempered_entropy"] * kinds["feature_distance"], **kinds}
