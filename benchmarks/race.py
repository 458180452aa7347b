"""Fair races on a shared machine: interleaved, in one process and thread, medians of CPU time."""

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Race:
    """What each candidate took, in milliseconds of CPU time."""

    name: str
    median_ms: Mapping[str, float]

    def table(self) -> str:
        """The median of each candidate, and its ratio to the first."""
        first = next(iter(self.median_ms.values()))
        rows = [
            f"  {name:<42} {ms:9.3f} ms {ms / first:8.2f} ×" for name, ms in self.median_ms.items()
        ]
        return "\n".join([self.name, *rows])


def race(name: str, candidates: Mapping[str, Callable[[int], object]], rounds: int = 60) -> Race:
    """Call every candidate once a round, with the round's number, so that it can change its input.

    The first two rounds do not count.
    """
    took: dict[str, list[float]] = {candidate: [] for candidate in candidates}
    for number in range(rounds + 2):
        for candidate, call in candidates.items():
            start = time.process_time_ns()
            call(number)
            if number >= 2:
                took[candidate].append((time.process_time_ns() - start) / 1e6)
    return Race(name, {candidate: statistics.median(times) for candidate, times in took.items()})
