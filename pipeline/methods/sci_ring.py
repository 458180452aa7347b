"""SCI on a ring: places at headings as the classes of one softmax, so every answer tells where it looks (METHODS 8)."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import softmax
from torch import Tensor, nn

from pipeline.errors import ConfigError, InputError
from pipeline.frames import yaw
from pipeline.matching import holdout
from pipeline.matching.novelties import novelties
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.rejection import Evidence, near
from pipeline.matching.temperature import temperature
from pipeline.networks import loop
from pipeline.networks.lenet import device
from pipeline.networks.ring import Ring
from pipeline.settings import check, positive
from pipeline.views.scan_context import colours, quantize
from pipeline.watch import Watch

HEADING_SOFTNESS = 2.0
"""The first place's headings are weighed at this temperature: the mean of sharper chances leans to the nearest of them, as
held-out blocks of two simulated worlds showed."""
Batch = tuple[Tensor, Tensor, Tensor]
"""Images (b, channels, rings, sectors), their places (b,) and their yaw (b,) in headings, a fraction of which may be left."""


@dataclass(frozen=True)
class SciRing:
    """Ours; neither paper's."""

    view: str = "scan_context"
    """Of columns that turn counter-clockwise."""
    colormap: Literal["jet", "grey"] = "jet"
    h_min_m: float = 0.0
    h_max_m: float = 15.0
    """Heights are clipped to [h_min_m, h_max_m] before they are coloured."""
    epochs: int = 400
    """In one each training view is shown once, turned at random: two are as long as one of two-way SCI."""
    batch: int = 64
    learning_rate: float = 0.002
    schedule: Literal["one_cycle", "constant"] = "one_cycle"
    dropout: float = 0.7
    batch_norm_momentum: float = 0.1
    yaw_noise_deg: float = 0.0
    """Standard deviation of what is added to the yaw of each training view, to study how well it must be known."""
    precision: Literal["auto", "bf16", "f32"] = "auto"
    threads: int = 2
    """Fixed, since the order of sums follows from it and the weights from that."""
    seed: int = 0
    held_out_every_m: float = 40.0
    held_out_length_m: float = 4.0
    """One block of this length in every `held_out_every_m` of the training path chooses the epoch and the threshold."""
    neighbour_m: float = 20.0
    """A held-out query counts as unseen once the places and training views nearer than this are forgotten."""

    def __post_init__(self) -> None:
        check(self, "method")
        positive("method", epochs=self.epochs, batch=self.batch, threads=self.threads, learning_rate=self.learning_rate)
        positive("method", held_out_every_m=self.held_out_every_m, h_max_m=self.h_max_m - self.h_min_m)
        if not 0 <= self.dropout <= 1:
            raise ConfigError(f"method.dropout={self.dropout}: expected a share from 0 to 1")
        if self.yaw_noise_deg < 0:
            raise ConfigError(f"method.yaw_noise_deg={self.yaw_noise_deg}: expected a number of at least 0")

    def learn(self, views: Rows, places: NDArray[np.int64], watch: Watch) -> Model:
        """Train on the views of the training sequence; raises InputError where 8 does not divide the sectors."""
        heights = torch.from_numpy(quantize(np.asarray(views.images[:]), self.h_min_m, self.h_max_m))
        rings, sectors = heights.shape[1:]
        if len(places) != len(heights) or (places < 0).any():
            raise InputError("every view of the training sequence needs a known place")
        held = holdout.blocks(views.world_T_anchor, places, self.held_out_every_m, self.held_out_length_m)
        where, count = device(), int(places.max()) + 1
        noise_deg = np.random.default_rng(self.seed).normal(0, self.yaw_noise_deg, len(places))
        columns = torch.from_numpy((np.rad2deg(yaw(views.world_T_anchor)) + noise_deg) * (sectors / 360)).float()
        classes = torch.from_numpy(places)
        trained = torch.from_numpy(np.flatnonzero(~held))
        held = held if held.any() else ~held  # a path too short for blocks is judged on what it trained

        with loop.reproducible(self.threads):
            torch.manual_seed(self.seed)
            channels = len(colours(self.colormap)[0])
            net = Ring(count, rings, sectors, channels, self.dropout, self.batch_norm_momentum).to(where)

            def batches(order: torch.Generator) -> Iterator[Batch]:
                """Every trained view once, in a new order, each turned by columns of its own."""
                for chosen in torch.split(trained[torch.randperm(len(trained), generator=order)], self.batch):
                    if len(chosen) > 1 or len(trained) == 1:  # a batch of one says nothing of the statistics
                        turns = torch.randint(sectors, (len(chosen),), generator=order)
                        headings = (columns[chosen] - turns) * (net.headings / sectors)
                        images = self._images(rolled(heights[chosen], turns), where)
                        yield images, classes[chosen].to(where), headings.to(where)

            def judge(net: Ring) -> tuple[float, float]:
                scores, _, _ = self._look(net, heights[held])
                loss = nn.functional.cross_entropy(scores, classes[held])
                return float(loss), float((scores.argmax(1) == classes[held]).float().mean())

            result = loop.fit(
                net,
                batches,
                judge,
                epochs=max(1, round(self.epochs * watch.budget)),
                steps=-(-len(trained) // self.batch),
                learning_rate=self.learning_rate,
                schedule=self.schedule,
                precision=self.precision,
                seed=self.seed,
                watch=watch,
                step=jointly,
            )
            net.load_state_dict(result.weights)
            xy = views.world_T_anchor[:, :2, 3]
            place_xy = np.stack([np.bincount(places, xy[:, axis]) / np.bincount(places) for axis in (0, 1)], axis=1)
            forgotten = near(xy[held], place_xy, self.neighbour_m)
            memory = self._remembered(net, heights, columns)
            seen = self._look(net, heights[held])
            unseen = self._look(net, heights[held], torch.from_numpy(forgotten))
        scores, others = seen[0].numpy().astype(np.float64), unseen[0].numpy().astype(np.float64)
        softness = temperature(scores, places[held])
        known = memory[trained].numpy()
        away = ~near(xy[held], xy[trained.numpy()], self.neighbour_m)
        evidence = Evidence(
            scores.argmax(axis=1) == places[held],
            _novelties(scores, softness, (seen[2].numpy() @ known.T).max(axis=1)),
            _novelties(others, softness, np.where(away, unseen[2].numpy() @ known.T, -1).max(axis=1)),
        )
        return {
            **{f"net/{name}": value.cpu().contiguous().numpy() for name, value in result.weights.items()},
            "place_xy_m": place_xy,
            "memory": memory.numpy(),
            "memory_xy_m": xy.copy(),
            "temperature": np.array(softness),
            **evidence.arrays(),
            "image_shape": np.array([rings, sectors]),
            "best_epoch": np.array(result.best_epoch),
            **{f"curves/{name}": column for name, column in zip(loop.CURVES, result.curves.T.copy(), strict=True)},
        }

    def localizer(self, model: Model) -> Localizer:
        """The k places of highest softmax, summed over headings; cost = 1 − probability.

        The first lies where the likest training view stands, whatever its place; the others at the mean of their views.
        """
        place_xy, softness = model["place_xy_m"], float(model["temperature"])
        rings, sectors = (int(side) for side in model["image_shape"])
        net = Ring(len(place_xy), rings, sectors, len(colours(self.colormap)[0]))
        net.load_state_dict(
            {n.removeprefix("net/"): torch.from_numpy(v.copy()) for n, v in model.items() if n.startswith("net/")}
        )
        net.to(device())
        memory = torch.from_numpy(model["memory"].copy())

        def localize(views: Rows, k: int) -> Ranking:
            heights = torch.from_numpy(quantize(np.asarray(views.images[:]), self.h_min_m, self.h_max_m))
            if heights.shape[1:] != (rings, sectors):
                raise InputError(f"views of {tuple(heights.shape[1:])}: the model learned {rings} rings × {sectors} sectors")
            with loop.reproducible(self.threads):
                logits, heading_deg, features = self._look(net, heights)
                likest = [(part @ memory.T).max(1) for part in torch.split(features, 512)]
            scores = logits.numpy().astype(np.float64)
            probability = softmax(scores, axis=1)
            novelty = _novelties(scores, softness, torch.cat([part.values for part in likest]).numpy())
            places = np.argsort(-probability, axis=1, kind="stable")[:, :k]
            xy = place_xy[places]
            xy[:, 0] = model["memory_xy_m"][torch.cat([part.indices for part in likest]).numpy()]
            return Ranking(
                places.astype(np.int64),
                (1 - np.take_along_axis(probability, places, axis=1)).astype(np.float32),
                xy,
                np.stack([*novelty.values()], axis=1).astype(np.float32),
                softmax(scores / softness, axis=1).max(axis=1).astype(np.float32),
                heading_deg.numpy(),
                tuple(novelty),
            )

        return localize

    def _images(self, heights: Tensor, where: torch.device) -> Tensor:
        """Coloured images (batch, channels, rings, sectors) in [0, 1] of quantized heights (batch, rings, sectors)."""
        table = torch.from_numpy(colours(self.colormap)).to(where).float() / 255
        return table[heights.to(where).long()].permute(0, 3, 1, 2)

    @torch.inference_mode()
    def _look(self, net: Ring, heights: Tensor, forgotten: Tensor | None = None) -> tuple[Tensor, Tensor, Tensor]:
        """Of quantized heights (n, rings, sectors): logits of places (n, places), heading in degrees (n,) given the first of
        them, and the features (n, 64) of length 1 there, between the two next to it; places may be `forgotten` (n, places)."""
        net.eval()
        where = next(net.parameters()).device
        found = []
        for rows in torch.split(torch.arange(len(heights)), self.batch):
            embedded = net.embed(self._images(heights[rows], where))
            logits = net.place(embedded).float()
            if forgotten is not None:
                logits = logits.masked_fill(forgotten[rows].to(where)[:, None], -torch.inf)
            scores, each = logits.logsumexp(1), torch.arange(len(rows))
            heading_deg = circular_mean_deg((logits[each, :, scores.argmax(1)] / HEADING_SOFTNESS).softmax(1))
            first, second, share = neighbours(heading_deg * (net.headings / 360), net.headings)
            features = embedded[each, first].lerp(embedded[each, second], share[:, None])
            found.append((scores, heading_deg, nn.functional.normalize(features)))
        answers, headings_deg, likenesses = (torch.cat(parts).cpu() for parts in zip(*found, strict=True))
        return answers, headings_deg, likenesses

    @torch.inference_mode()
    def _remembered(self, net: Ring, heights: Tensor, columns: Tensor) -> Tensor:
        """Features (n, 64) of length 1 of training views, each turned to look along +x."""
        net.eval()
        where = next(net.parameters()).device
        north = rolled(heights, columns.round().long())
        parts = [net.embed(self._images(part, where))[:, 0] for part in torch.split(north, self.batch)]
        return nn.functional.normalize(torch.cat(parts)).cpu()


def jointly(answer: Callable[[Tensor], Tensor], batch: Batch) -> tuple[Tensor, Tensor, int]:
    """Cross-entropy in nats over headings × places at once, and how often the likeliest place is right.

    The target is split linearly between the two headings nearest the true one.
    """
    images, classes, headings = batch
    logits = answer(images).float()
    chances = logits.flatten(1).log_softmax(1).view_as(logits)
    first, second, share = neighbours(headings, logits.shape[1])
    each = torch.arange(len(classes), device=classes.device)
    told = chances[each, first, classes].lerp(chances[each, second, classes], share)
    return -told.mean(), (logits.logsumexp(1).argmax(1) == classes).sum(), len(classes)


def neighbours(headings: Tensor, count: int) -> tuple[Tensor, Tensor, Tensor]:
    """The two of `count` headings next to each fractional one (n,), and how far (n,) it is from the first to the second."""
    below = headings.floor()
    first = below.long() % count
    return first, (first + 1) % count, headings - below


def rolled(heights: Tensor, turns: Tensor) -> Tensor:
    """Heights (n, rings, sectors), each rolled by its own number of columns (n,)."""
    columns = (torch.arange(heights.shape[2]) - turns[:, None]) % heights.shape[2]
    return heights.gather(2, columns[:, None].expand_as(heights))


def circular_mean_deg(chances: Tensor) -> Tensor:
    """Degrees (n,) in (−180, 180] of chances (n, heading) of headings even around the circle, the first at 0."""
    angles = 2 * torch.pi * torch.arange(chances.shape[1], device=chances.device) / chances.shape[1]
    turned = torch.atan2(chances @ angles.sin(), chances @ angles.cos()).rad2deg()
    return 180 - (180 - turned) % 360


def _novelties(scores: NDArray[np.float64], softness: float, likeness: NDArray[np.floating]) -> dict[str, NDArray[np.float64]]:
    """The kinds of novelty, the one in use first: the place's doubt times the features', new only where both say so.

    Of the two simulated worlds' held-out blocks neither factor alone had as much of both AUROC and area under the curve.
    """
    kinds = novelties(scores, softness, likeness.astype(np.float64))
    return {"combined": kinds["tempered_entropy"] * kinds["feature_distance"], **kinds}
