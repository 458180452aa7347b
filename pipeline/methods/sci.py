"""SCI localisation: places as classes of a small CNN over Scan Context Images (Kim, Park and Kim, RA-L 2019; METHODS 2)."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import softmax
from torch import Tensor, nn

from pipeline.errors import ConfigError, InputError
from pipeline.matching import holdout
from pipeline.matching.novelties import novelties
from pipeline.matching.ranking import Localizer, Model, Ranking, Rows
from pipeline.matching.rejection import Evidence, near
from pipeline.matching.temperature import temperature
from pipeline.networks import loop
from pipeline.networks.lenet import LeNet, device
from pipeline.settings import check, positive
from pipeline.views.scan_context import colours, quantize
from pipeline.watch import Watch


@dataclass(frozen=True)
class Sci:
    """The paper's recipe."""

    view: str = "scan_context"
    n_way: int = 2
    """Copies of each training image, turned by 360°/n_way; the authors ship 2, forward and reversed."""
    colormap: Literal["jet", "grey"] = "jet"
    h_min_m: float = 0.0
    h_max_m: float = 15.0
    """Heights are clipped to [h_min_m, h_max_m] before they are coloured."""
    epochs: int = 200
    batch: int = 64
    learning_rate: float = 0.002
    schedule: Literal["one_cycle", "constant"] = "one_cycle"
    """The authors' is constant; falling at the end is what makes a short training good."""
    dropout: float = 0.7
    batch_norm_momentum: float = 0.1
    """The authors' 0.01 needs some 500 steps to forget the first weights: more than a short training has."""
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

    def learn(self, views: Rows, places: NDArray[np.int64], watch: Watch) -> Model:
        """Train on the views of the training sequence; raises ConfigError where n_way does not divide the sectors."""
        heights = torch.from_numpy(quantize(np.asarray(views.images[:]), self.h_min_m, self.h_max_m))
        rings, sectors = heights.shape[1:]
        if self.n_way < 1 or sectors % self.n_way:
            raise ConfigError(f"method.n_way={self.n_way}: must divide the {sectors} sectors of the view")
        if len(places) != len(heights) or (places < 0).any():
            raise InputError("every view of the training sequence needs a known place")
        held = holdout.blocks(views.world_T_anchor, places, self.held_out_every_m, self.held_out_length_m)
        where, count = device(), int(places.max()) + 1
        classes = torch.from_numpy(places)
        trained = torch.from_numpy(np.flatnonzero(~held))
        held = held if held.any() else ~held  # a path too short for blocks is judged on what it trained
        turns = torch.arange(self.n_way) * (sectors // self.n_way)

        def turned(chosen: Tensor) -> Tensor:
            """Heights of trained views: number i is view i // n_way at heading i % n_way."""
            columns = (torch.arange(sectors) - turns[chosen % self.n_way, None]) % sectors
            return heights[trained[chosen // self.n_way]].gather(2, columns[:, None].expand(-1, rings, -1))

        def batches(order: torch.Generator) -> Iterator[tuple[Tensor, Tensor]]:
            """Every trained view at every heading, once, in a new order."""
            for chosen in torch.split(torch.randperm(len(trained) * self.n_way, generator=order), self.batch):
                if len(chosen) > 1 or len(trained) * self.n_way == 1:  # a batch of one says nothing of the statistics
                    yield self._images(turned(chosen), where), classes[trained[chosen // self.n_way]].to(where)

        def judge(net: LeNet) -> tuple[float, float]:
            logits, _ = self._look(net, heights[held])
            loss = nn.functional.cross_entropy(logits, classes[held])
            return float(loss), float((logits.argmax(1) == classes[held]).float().mean())

        with loop.reproducible(self.threads):
            torch.manual_seed(self.seed)
            net = LeNet(count, rings, sectors, len(colours(self.colormap)[0]), self.dropout, self.batch_norm_momentum).to(where)
            result = loop.fit(
                net,
                batches,
                judge,
                epochs=max(1, round(self.epochs * watch.budget)),
                steps=-(-len(trained) * self.n_way // self.batch),
                learning_rate=self.learning_rate,
                schedule=self.schedule,
                precision=self.precision,
                seed=self.seed,
                watch=watch,
            )
            net.load_state_dict(result.weights)
            logits, features = self._look(net, heights[held])
            _, memory = self._look(net, turned(torch.arange(len(trained) * self.n_way)))
        xy = views.world_T_anchor[:, :2, 3]
        place_xy = np.stack([np.bincount(places, xy[:, axis]) / np.bincount(places) for axis in (0, 1)], axis=1)
        scores = logits.numpy().astype(np.float64)
        likeness = (features @ memory.T).numpy().astype(np.float64)
        softness = temperature(scores, places[held])
        near_places = near(xy[held], place_xy, self.neighbour_m)
        near_memory = near(xy[held], np.repeat(xy[trained.numpy()], self.n_way, axis=0), self.neighbour_m)
        evidence = Evidence(
            scores.argmax(axis=1) == places[held],
            novelties(scores, softness, likeness.max(axis=1)),
            novelties(np.where(near_places, -np.inf, scores), softness, np.where(near_memory, -1, likeness).max(axis=1)),
        )
        return {
            **{f"net/{name}": value.cpu().contiguous().numpy() for name, value in result.weights.items()},
            "place_xy_m": place_xy,
            "memory": memory.numpy(),
            "temperature": np.array(softness),
            **evidence.arrays(),
            "image_shape": np.array([rings, sectors]),
            "best_epoch": np.array(result.best_epoch),
            **{f"curves/{name}": column for name, column in zip(loop.CURVES, result.curves.T.copy(), strict=True)},
        }

    def localizer(self, model: Model) -> Localizer:
        """The k places of highest softmax; cost = 1 − probability."""
        place_xy, softness = model["place_xy_m"], float(model["temperature"])
        rings, sectors = (int(side) for side in model["image_shape"])
        net = LeNet(len(place_xy), rings, sectors, len(colours(self.colormap)[0]))
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
                logits, features = self._look(net, heights)
                likest = [(part @ memory.T).amax(1) for part in torch.split(features, 512)]
            scores = logits.numpy().astype(np.float64)
            probability, novelty = softmax(scores, axis=1), novelties(scores, softness, torch.cat(likest).numpy())
            places = np.argsort(-probability, axis=1, kind="stable")[:, :k]
            return Ranking(
                places.astype(np.int64),
                (1 - np.take_along_axis(probability, places, axis=1)).astype(np.float32),
                place_xy[places],
                np.stack([*novelty.values()], axis=1).astype(np.float32),
                softmax(scores / softness, axis=1).max(axis=1).astype(np.float32),
                np.full(len(places), np.nan, np.float32),
                tuple(novelty),
            )

        return localize

    def _images(self, heights: Tensor, where: torch.device) -> Tensor:
        """Coloured images (batch, channels, rings, sectors) in [0, 1] of quantized heights (batch, rings, sectors)."""
        table = torch.from_numpy(colours(self.colormap)).to(where).float() / 255
        return table[heights.to(where).long()].permute(0, 3, 1, 2)

    @torch.inference_mode()
    def _look(self, net: LeNet, heights: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (n, places) and features (n, 64) of length 1 of quantized heights (n, rings, sectors)."""
        net.eval()
        where = next(net.parameters()).device
        parts = [net.embed(self._images(part, where)) for part in torch.split(heights, self.batch)]
        embedded = torch.cat(parts)
        return net.head[3:](embedded).float().cpu(), nn.functional.normalize(embedded.float()).cpu()
