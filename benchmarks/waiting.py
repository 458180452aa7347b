"""A training step of SCI's network while OpenMP's threads sleep or spin as they wait.

It has two threads, beside two busy processes and alone. Wall time counts, not CPU time, which
includes spinning. Each candidate is a process of its own, since OpenMP reads its settings when
torch is loaded.
"""

import os
import statistics
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from benchmarks.race import Race

BATCH = 64
PLACES = 100
STEPS = 4
ROUNDS = 3
CANDIDATES: Mapping[str, Mapping[str, str]] = {
    "yearloc: OMP_WAIT_POLICY=passive": {"OMP_WAIT_POLICY": "passive"},
    "OpenMP's default: spin, then sleep": {},
}


def step_ms() -> float:
    """The median wall time of a training step in this process, in milliseconds."""
    import torch

    from pipeline.networks import loop
    from pipeline.networks.lenet import LeNet

    with loop.reproducible(2):
        torch.manual_seed(0)
        net = LeNet(PLACES)
        images = torch.rand(BATCH, 3, 40, 120)
        places = torch.randint(PLACES, (BATCH,))
        optimizer = torch.optim.Adam(net.parameters())
        took = []
        for _ in range(STEPS + 2):
            start = time.perf_counter_ns()
            optimizer.zero_grad()
            with loop.autocast(torch.device("cpu"), "auto"):
                loss = torch.nn.functional.cross_entropy(net(images), places)
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            took.append((time.perf_counter_ns() - start) / 1e6)
    return statistics.median(took[2:])


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """Keeps this many other processes busy in the block."""
    children = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(processes)
    ]
    try:
        yield
    finally:
        for child in children:
            child.kill()
            child.wait()


def run() -> list[Race]:
    """Interleaved races, with a fresh process for each candidate and round."""
    races = []
    for others in (2, 0):
        took: dict[str, list[float]] = {name: [] for name in CANDIDATES}
        with busy(others):
            for _ in range(ROUNDS):
                for name, settings in CANDIDATES.items():
                    env = {
                        key: value
                        for key, value in os.environ.items()
                        if not key.startswith(("OMP_", "GOMP_"))
                    }
                    command = [sys.executable, "-m", "benchmarks.waiting", "step"]
                    done = subprocess.run(
                        command,
                        env={**env, **settings},
                        capture_output=True,
                        text=True,
                        encoding="utf-8",
                        check=True,
                    )
                    took[name].append(float(done.stdout))
        medians = {name: statistics.median(times) for name, times in took.items()}
        races.append(
            Race(
                f"Training step of SCI, batch {BATCH}, two threads, {others} busy processes "
                "beside it, wall time",
                medians,
            )
        )
    return races


if __name__ == "__main__":
    if sys.argv[1:] == ["step"]:
        print(step_ms())
    else:
        for result in run():
            print(result.table())
