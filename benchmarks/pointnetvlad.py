"""Describing one cloud of 4,096 points by PointNetVLAD's network: as we localise, against eager
PyTorch."""

from collections.abc import Callable

import torch
from torch import Tensor

from benchmarks.race import Race, race
from pipeline.methods.pointnetvlad.netvlad import Describer, folded
from pipeline.networks import loop

CLOUDS = 8
POINTS = 4096


def run() -> list[Race]:
    """One cloud at a time, one thread, random weights."""
    with loop.reproducible(1), torch.inference_mode():
        torch.manual_seed(0)
        net = Describer().eval()
        clouds = torch.rand(CLOUDS, 1, POINTS, 3) * 2 - 1
        net.load_state_dict({name: value + 0.01 for name, value in net.state_dict().items()})
        single = folded(net)
        half = folded(net, torch.bfloat16)

        def cast(describe: Callable[[Tensor], Tensor]) -> Callable[[int], Tensor]:
            def call(number: int) -> Tensor:
                with torch.autocast("cpu", torch.bfloat16):
                    return describe(clouds[number % CLOUDS])

            return call

        for number in range(CLOUDS):
            truth = net(clouds[number])
            if (single(clouds[number]) - truth).norm() > 1e-4 or (
                cast(half)(number) - truth
            ).norm() > 0.02:
                raise AssertionError("the folded network's descriptor differs")
        return [
            race(
                f"PointNetVLAD's descriptor of {POINTS:,} points, batch 1",
                {
                    "yearloc, bfloat16, norms folded": cast(half),
                    "yearloc, float32, norms folded": lambda i: single(clouds[i % CLOUDS]),
                    "eager, bfloat16 autocast": cast(net),
                    "eager, float32": lambda i: net(clouds[i % CLOUDS]),
                },
                rounds=20,
            )
        ]


if __name__ == "__main__":
    for result in run():
        print(result.table())
