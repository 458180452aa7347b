"""Encoding one bird-view by place feature learning's encoder at full width: as we localise, against
eager PyTorch."""

import torch

from benchmarks.race import Race, race
from pipeline.methods.pfl.bigan import SIDE, Encoder, folded
from pipeline.networks import loop

IMAGES = 8


def run() -> list[Race]:
    """One image at a time, one thread, random weights.

    A code takes 1 KB, a place with eight headings 8 KB.
    """
    with loop.reproducible(1), torch.inference_mode():
        torch.manual_seed(0)
        encoder = Encoder()
        images = torch.rand(IMAGES, 1, 1, SIDE, SIDE) * 2 - 1
        for _ in range(4):  # running statistics unlike those of the start
            encoder(images[:, 0])
        encoder.eval()
        half = folded(encoder, torch.bfloat16)
        single = folded(encoder)
        for number in range(IMAGES):
            truth = encoder(images[number])
            apart = [
                float((net(images[number]) - truth).norm() / truth.norm()) for net in (single, half)
            ]
            if apart[0] > 1e-4 or apart[1] > 0.02:
                raise AssertionError(f"the folded encoder's code differs by {apart}")
        return [
            race(
                f"PFL's code of a {SIDE} × {SIDE} bird-view, batch 1",
                {
                    "yearloc, bfloat16, norms folded": lambda i: half(images[i % IMAGES]),
                    "yearloc, float32, norms folded": lambda i: single(images[i % IMAGES]),
                    "eager, float32": lambda i: encoder(images[i % IMAGES]),
                },
            )
        ]


if __name__ == "__main__":
    for result in run():
        print(result.table())
