"""Samples the time and memory that a stage uses, and stores them as the trace of its artifact.

A trace is a file of its own, since an artifact's bytes hold no clock and no host: the trace of
`artifacts/train/sci.zarr.zip` is `.telemetry/artifacts/train/sci.zarr.zip.json`. It describes the
last build of the artifact on this machine. Neither git nor DVC tracks traces, so a clone that pulls
the artifact has none.
"""

import json
import sys
import threading
import time
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Self

import psutil

from pipeline.core.replacing import write_text

FOLDER = Path(".telemetry")
MOST_SAMPLES = 200
"""A trace has at most so many samples, however long its stage runs."""
MB = 1e-6
"""Megabytes in a byte."""


def trace_path(artifact: str | Path) -> Path:
    """The path of an artifact's trace. Raises ValueError outside of the current folder."""
    path = FOLDER / Path(artifact).absolute().relative_to(Path.cwd())
    return path.with_name(f"{path.name}.json")


@dataclass(frozen=True)
class Trace:
    """The resources that a process and its children used, from start to end."""

    wall_s: float
    cpu_s: float
    peak_memory_mb: float
    """The largest resident memory of any sample, summed over processes: pages that they share
    count for each."""
    seconds: Sequence[float] = ()
    """(sample,) seconds since the start."""
    cpu_percent: Sequence[float] = ()
    """(sample,) mean since the sample before; 100 is one core."""
    memory_mb: Sequence[float] = ()
    """(sample,) resident memory."""
    gpu_memory_mb: Sequence[float] = ()
    """(sample,) memory that torch holds on its current GPU; empty without a GPU."""

    @classmethod
    def read(cls, artifact: str | Path) -> Self | None:
        """Read an artifact's trace; None if it has none, or one of another version."""
        try:
            return cls(**json.loads(trace_path(artifact).read_text(encoding="utf-8")))
        except (OSError, TypeError, ValueError):
            return None

    def write(self, artifact: str | Path) -> None:
        """Write the trace whole or not at all."""
        write_text(trace_path(artifact), json.dumps(asdict(self), allow_nan=False))

    def series(self) -> dict[str, list[tuple[int, float]]]:
        """The samples as MLflow logs system metrics: for each name, (whole second, value) pairs.

        Of several samples in one second the last counts.
        """
        columns = {
            "process_cpu_percentage": self.cpu_percent,
            "process_memory_megabytes": self.memory_mb,
            "gpu_memory_usage_megabytes": self.gpu_memory_mb,
        }
        steps = [round(at_s) for at_s in self.seconds]
        series = {}
        for name, column in columns.items():
            if column:
                value_by_step = dict(zip(steps, column, strict=True))
                series[f"system/{name}"] = list(value_by_step.items())
        return series


def costs(stages: Mapping[str, Sequence[Path]]) -> dict[str, float]:
    """The costs of each stage, such as `train_wall_s`, from the traces of all of its artifacts.

    A stage that lacks a trace has no costs: a part of a sum would be taken for the whole.
    """
    numbers: dict[str, float] = {}
    for stage, artifacts in stages.items():
        traces = [Trace.read(artifact) for artifact in artifacts]
        recorded = [trace for trace in traces if trace is not None]
        if recorded and len(recorded) == len(traces):
            numbers[f"{stage}_wall_s"] = sum(trace.wall_s for trace in recorded)
            numbers[f"{stage}_cpu_s"] = sum(trace.cpu_s for trace in recorded)
            numbers[f"{stage}_peak_memory_mb"] = max(trace.peak_memory_mb for trace in recorded)
    return numbers


class Sample(NamedTuple):
    """The resources of a process and all that it started, at one moment."""

    at_s: float
    """Seconds since the block began."""
    cpu_s: float
    """CPU time used since the process began, which may be long before the block."""
    memory_mb: float
    gpu_memory_mb: float | None


@dataclass
class Telemetry:
    """A `with` block in which this process and all that it starts are sampled.

    If the block ends without an error, the artifact's trace is written. A sample is taken every
    second at first. Whenever there are MOST_SAMPLES of them, every other one is dropped, and the
    time between samples doubles. No failure to sample or to write, such as a full disk, disturbs
    the block.
    """

    artifact: str | Path
    every_s: float = 1.0
    """The time from one sample to the next."""
    _samples: list[Sample] = field(default_factory=list)
    _peak_mb: float = 0.0
    _end: threading.Event = field(default_factory=threading.Event)

    def __enter__(self) -> Self:
        self._start_s = time.monotonic()
        self._process = psutil.Process()
        self._sample()
        self._thread = threading.Thread(target=self._run, name="telemetry", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._end.set()
        self._thread.join()
        if kind is None:
            self._sample()
            with suppress(Exception):
                self._trace().write(self.artifact)

    def _run(self) -> None:
        """Take samples until the block ends, in a thread of its own."""
        while not self._end.wait(self.every_s):
            self._sample()
            if len(self._samples) >= MOST_SAMPLES:
                del self._samples[1::2]  # the first stays: all are measured from it
                self.every_s *= 2

    def _sample(self) -> None:
        """Take one sample; none where that fails."""
        cpu_s = 0.0
        memory_mb = 0.0
        with suppress(Exception):
            for process in (self._process, *self._process.children(recursive=True)):
                with suppress(psutil.NoSuchProcess):
                    # user and system time, its own and that of its children that have ended
                    cpu_s += sum(process.cpu_times()[:4])
                    memory_mb += process.memory_info().rss * MB
            at_s = time.monotonic() - self._start_s
            self._samples.append(Sample(at_s, cpu_s, memory_mb, _gpu_memory_mb()))
            self._peak_mb = max(self._peak_mb, memory_mb)

    def _trace(self) -> Trace:
        """Sum up the samples: all but the first, from which they are measured."""
        start, *samples = self._samples
        last_sample = samples[-1]
        if len(samples) > 1 and last_sample.at_s - samples[-2].at_s < self.every_s / 2:
            samples.pop()  # too near the one before for a rate
        rates = [
            (later.cpu_s - earlier.cpu_s) / max(later.at_s - earlier.at_s, 1e-3)
            for earlier, later in pairwise([start, *samples])
        ]
        gpu_memory_mb = []
        if last_sample.gpu_memory_mb is not None:
            gpu_memory_mb = [round(sample.gpu_memory_mb or 0.0, 1) for sample in samples]
        return Trace(
            wall_s=round(last_sample.at_s, 3),
            cpu_s=round(max(last_sample.cpu_s - start.cpu_s, 0.0), 3),
            peak_memory_mb=round(self._peak_mb, 1),
            seconds=[round(sample.at_s, 3) for sample in samples],
            cpu_percent=[round(max(100 * rate, 0.0), 1) for rate in rates],
            memory_mb=[round(sample.memory_mb, 1) for sample in samples],
            gpu_memory_mb=gpu_memory_mb,
        )


def _gpu_memory_mb() -> float | None:
    """The GPU memory that torch holds; None unless this process uses torch on a GPU already."""
    # to ask torch for it otherwise would start the GPU
    cuda = getattr(sys.modules.get("torch"), "cuda", None)
    is_in_use = getattr(cuda, "is_initialized", bool)()  # torch may be half imported
    return cuda.memory_reserved() * MB if cuda and is_in_use else None
