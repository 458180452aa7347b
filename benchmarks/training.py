"""Training steps of SCI's network and of `sci_ring`: images a second, and share of peak arithmetic.

`python -m benchmarks.training`: on a processor by CPU time of one thread, against products of large
matrices in the same precision; on a GPU, if there is one, by wall time, since it works while the
processor waits.
"""

import resource
import time
from collections.abc import Callable
from functools import partial

import torch
from torch import nn
from torch.utils.flop_counter import FlopCounterMode

import stages  # noqa: F401 — keeps freed memory, as every stage does
from pipeline.methods.sci_ring.ring import Ring
from pipeline.networks import loop
from pipeline.networks.lenet import LeNet

PLACES = 579
STEPS = 10
SIDE = 2048  # the papers' places at 10 m


def trained(kind: type[nn.Module], where: torch.device, batch: int) -> Callable[[], None]:
    """A training step in the precision that `auto` takes there, whose images are there already."""
    torch.manual_seed(0)
    net = kind(PLACES).to(where)
    images = torch.rand(batch, 3, 40, 120, device=where)
    places = torch.randint(PLACES, (batch,), device=where)
    optimizer = torch.optim.Adam(net.parameters())

    def step() -> None:
        optimizer.zero_grad(set_to_none=True)
        with loop.autocast(where, "auto"):
            logits = net(images).float().view(batch, -1, PLACES).logsumexp(1)
        nn.functional.cross_entropy(logits, places).backward()  # type: ignore[no-untyped-call]
        optimizer.step()

    return step


def seconds(step: Callable[[], object], where: torch.device) -> float:
    """Mean time of a step after two warm-up steps: CPU time, or wall time on a GPU."""
    clock = time.perf_counter if where.type == "cuda" else time.process_time
    for number in range(STEPS + 2):
        if number == 2:
            _wait(where)
            start = clock()
        step()
    _wait(where)
    return (clock() - start) / STEPS


def _wait(where: torch.device) -> None:
    if where.type == "cuda":
        torch.cuda.synchronize()


def main() -> None:
    for name in ("cpu", *(["cuda"] if torch.cuda.is_available() else [])):
        where = torch.device(name)
        with loop.reproducible(1):
            matrix = torch.rand(SIDE, SIDE, device=where).to(loop.dtype(where, "auto"))
            peak = 2 * SIDE**3 / seconds(partial(torch.mm, matrix, matrix), where)
            for kind in (LeNet, Ring):
                for batch in (64, 512):
                    step = trained(kind, where, batch)
                    with FlopCounterMode(display=False) as counter:
                        step()
                    took_s = seconds(step, where)
                    share = counter.get_total_flops() / took_s / peak
                    kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
                    most_mb = (
                        torch.cuda.max_memory_allocated() / 1e6 if name == "cuda" else kb / 1e3
                    )
                    speed = (
                        f"{batch / took_s:7.0f} images a {'CPU-' if name == 'cpu' else ''}second"
                    )
                    print(
                        f"{name:<5}{kind.__name__:<6} batch {batch:>3} {speed}, {share:4.0%} of "
                        f"the peak, {most_mb:.0f} MB"
                    )


if __name__ == "__main__":
    main()
