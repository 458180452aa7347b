"""Which sectors carry sci_ring's right and wrong answers: `python -m benchmarks.sectors
STUDY/GRID/MODEL TRAIN DAY picture.png`.

FC1 and FC2 are linear, so a place's score is the sum of what 15 sectors of the image say. Each seen
query is compared, turned to north, with the training view nearest to it in truth. A sector is the
*same* where the nearest thing that stands is within a ring in both, *hidden* where the query sees
something nearer, *gone* where it sees farther. Drawn are the queries on the map, how many sectors
are the same, and how much each kind speaks for the true place against the likeliest other.
"""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from omegaconf import OmegaConf
from scipy.spatial import KDTree

from pipeline.core import schemas, store
from pipeline.core.frames import yaw
from pipeline.matching.outlines import outlines
from pipeline.matching.ranking import Rows
from pipeline.methods.sci_ring.ring import POOLED, Ring
from pipeline.methods.sci_ring.sci_ring import SciRing
from pipeline.networks import loop
from pipeline.networks.classifier import rolled
from pipeline.views.scan_context import quantize
from stages import build

ROOT = Path("artifacts")
KINDS = "same", "hidden", "gone"


def northed(images: NDArray[np.float32], poses: NDArray[np.float64]) -> NDArray[np.float32]:
    """Views (n, rings, sectors) as sensors would see them that look along the world's +x."""
    columns = np.rint(yaw(poses) * images.shape[2] / (2 * np.pi)).astype(int)
    return rolled(torch.from_numpy(images), torch.from_numpy(columns)).numpy()


def kinds(queries: NDArray[np.float32], trained: NDArray[np.float32]) -> NDArray[np.str_]:
    """Kind (n, 15) of each sector of the features: that of most of its columns, of views that look
    the same way."""
    off = outlines(queries).astype(int) - outlines(trained).astype(int)
    parts = np.stack([abs(off) <= 1, off < -1, off > 1], axis=-1)
    votes = parts.reshape(len(queries), -1, POOLED, 3).sum(2)
    named: NDArray[np.str_] = np.array(KINDS)[votes.argmax(-1)]
    return named


@torch.inference_mode()
def evidence(method: SciRing, net: Ring, images: NDArray[np.float32]) -> NDArray[np.float32]:
    """What each sector says for each place (n, sector, place) of views that look north, in nats,
    without biases."""
    heights = torch.from_numpy(quantize(images, method.h_min_m, method.h_max_m))
    said = [
        net.products(method.images(part))[:, net.by_sector[0]] @ net.fc2.weight.T
        for part in torch.split(heights, 64)
    ]
    return torch.cat(said).numpy()


def measured(
    name: str, train: str, day: str
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.str_], NDArray[np.float32]]:
    """Positions (n, 2) of the seen queries, the rank of the true place, each sector's kind and what
    it says for that place."""
    study, grid, model_name = name.split("/")
    model = store.read_model(ROOT / "train" / study / grid / f"{model_name}{store.MODEL}")
    method: SciRing = build("method", "sci_ring")
    net = Ring(len(model["place_xy_m"]), *(int(side) for side in model["image_shape"])).eval()
    loop.fill(net, model)
    labels = store.read(ROOT / "labels" / study / grid / f"{day}.zarr", schemas.Labels)
    queries, trained = (
        Rows.read(ROOT / "views" / study / method.view / f"{one}.zarr") for one in (day, train)
    )
    places = labels.load("places")
    seen = np.flatnonzero(places >= 0)
    poses = queries.world_T_anchor[seen]
    nearest = KDTree(trained.world_T_anchor[:, :2, 3]).query(poses[:, :2, 3])[1]
    images = northed(queries.images[:][seen], poses)
    kind = kinds(images, northed(trained.images[:][nearest], trained.world_T_anchor[nearest]))
    asked = replace(queries, images=queries.images[:][seen], world_T_anchor=poses)
    ranked = method.localizer(model)(asked, len(model["place_xy_m"])).places
    rank = (ranked == places[seen][:, None]).argmax(1)
    rival = np.where(rank > 0, ranked[:, 0], ranked[:, 1])
    said = evidence(method, net, images)
    row = np.arange(len(seen))
    return poses[:, :2, 3], rank, kind, said[row, :, places[seen]] - said[row, :, rival]


def main(name: str, train: str, day: str, picture: str) -> None:
    """Print the sums, and draw them."""
    xy_m, rank, kind, said = measured(name, train, day)
    groups = {"right": rank == 0, "second to 25th": (rank > 0) & (rank < 25), "later": rank >= 25}
    simulated = OmegaConf.load(Path("conf", "dataset", f"{name.split('/')[0]}.yaml")).simulated
    fig = Figure(figsize=(11, 3.6), layout="constrained")
    fig.suptitle(
        f"{'simulated: ' if simulated else ''}{name}, {day}, learned on {train}", fontsize=10
    )
    where, counts, sums = fig.subplots(1, 3)
    for (group, rows), tint in zip(groups.items(), ("#2c7fb8", "#fdae61", "#d7191c"), strict=True):
        where.scatter(
            *xy_m[rows].T,
            s=9,
            color=tint,
            label=f"{group} ({rows.mean():.0%})",
            zorder=2 + (group != "right"),
        )
        counts.hist((kind[rows] == "same").sum(1), np.arange(17) - 0.5, histtype="step", color=tint)
        spoken = [float(said[rows][kind[rows] == one].sum() / max(rows.sum(), 1)) for one in KINDS]
        shares = [float((kind[rows] == one).mean()) for one in KINDS] if rows.any() else [0.0] * 3
        told = "  ".join(
            f"{one}: {share:.0%} say {nats:+.1f}"
            for one, share, nats in zip(KINDS, shares, spoken, strict=True)
        )
        print(f"{group:15} {rows.sum():4} queries; {told} nats for the true place")
        sums.bar(np.arange(3) + 0.27 * (list(groups).index(group) - 1), spoken, 0.25, color=tint)
    where.set(aspect="equal", xlabel="east [m]", ylabel="north [m]", title="the true place's rank")
    where.legend(fontsize=7)
    counts.set(xlabel="of 15 sectors the same as in training", ylabel="queries")
    sums.set(xticks=range(3), xticklabels=list(KINDS), ylabel="nats for the true place, a query")
    sums.axhline(0, color="0.6", linewidth=0.8)
    fig.savefig(picture, dpi=120)


if __name__ == "__main__":
    main(*sys.argv[1:])
