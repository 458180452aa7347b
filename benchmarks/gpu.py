"""Images a second that SCI's network trains on, and the memory that it takes: this processor, and a GPU where there is one.

`python -m benchmarks.gpu`: wall time, since a GPU works while the processor waits.
"""

import resource
import time

import torch

from pipeline.networks import loop
from pipeline.networks.lenet import LeNet

PLACES, BATCHES, STEPS = 579, (64, 512), 10  # the papers' places at 10 m


def images_per_second(where: torch.device, batch: int) -> float:
    """Of training steps in the precision that `auto` takes there, whose images are there already."""
    torch.manual_seed(0)
    net = LeNet(PLACES).to(where)
    images, places = torch.rand(batch, 3, 40, 120, device=where), torch.randint(PLACES, (batch,), device=where)
    optimizer = torch.optim.Adam(net.parameters())
    for step in range(STEPS + 2):
        if step == 2:
            _wait(where)
            start = time.perf_counter()
        optimizer.zero_grad(set_to_none=True)
        with loop.autocast(where, "auto"):
            loss = torch.nn.functional.cross_entropy(net(images), places)
        loss.backward()  # type: ignore[no-untyped-call]
        optimizer.step()
    _wait(where)
    return batch * STEPS / (time.perf_counter() - start)


def _wait(where: torch.device) -> None:
    if where.type == "cuda":
        torch.cuda.synchronize()


def main() -> None:
    for name in ("cpu", *(["cuda"] if torch.cuda.is_available() else [])):
        where = torch.device(name)
        for batch in BATCHES:
            with loop.reproducible(2):
                speed = images_per_second(where, batch)
            processor_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
            peak_mb = torch.cuda.max_memory_allocated() / 1e6 if name == "cuda" else processor_kb / 1e3
            title = torch.cuda.get_device_name() if name == "cuda" else "processor, 2 threads"
            print(f"{title:<28} batch {batch:>4}  {loop.dtype(where, 'auto')}  {speed:9.0f} images/s  {peak_mb:8.0f} MB at most")


if __name__ == "__main__":
    main()
