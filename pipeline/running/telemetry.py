"""Time and memory that a stage used, stored beside its artifact.

Never in it: an artifact's bytes hold no clock and no host. The trace of
`artifacts/train/sci.zarr.zip` is `.telemetry/artifacts/train/sci.zarr.zip.json`, which
neither git nor DVC tracks: a clone that pulls the artifact has none. It is of the last time that
the artifact was built here.
"""

import json
import os
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

FOLDER = Path(".telemetry")
MOST = 200
"""Samples kept of one stage, however long it runs."""
MB = 1e-6


def trace_path(artifact: str | Path) -> Path:
    """The path of an artifact's trace; raises ValueError for one outside the current folder."""
    path = FOLDER / Path(artifact).absolute().relative_to(Path.cwd())
    return path.with_name(f"{path.name}.json")


@dataclass(frozen=True)
class Trace:
    """Resources used by a process and its children, from start to end."""

    wall_s: float
    cpu_s: float
    peak_memory_mb: float
    """Largest resident memory among the samples, processes added up (shared pages count in
    each)."""
    seconds: Sequence[float] = ()
    """(sample,) since the start."""
    cpu_percent: Sequence[float] = ()
    """(sample,) mean since the sample before; 100 is one core."""
    memory_mb: Sequence[float] = ()
    """(sample,) resident."""
    gpu_memory_mb: Sequence[float] = ()
    """(sample,) that torch holds on its current GPU; empty where it has none."""

    @classmethod
    def read(cls, artifact: str | Path) -> Self | None:
        """Read an artifact's trace; None where there is none, or one of another version."""
        try:
            return cls(**json.loads(trace_path(artifact).read_text(encoding="utf-8")))
        except (OSError, TypeError, ValueError):
            return None

    def write(self, artifact: str | Path) -> None:
        """Write the trace whole or not at all."""
        path = trace_path(artifact)
        path.parent.mkdir(parents=True, exist_ok=True)
        scratch = path.with_name(f".{path.name}.{os.getpid()}.scratch")
        scratch.write_text(json.dumps(asdict(self), allow_nan=False), encoding="utf-8")
        scratch.replace(path)

    def series(self) -> dict[str, list[tuple[int, float]]]:
        """The samples over whole seconds, in the group of MLflow's system metrics."""
        columns = {
            "process_cpu_percentage": self.cpu_percent,
            "process_memory_megabytes": self.memory_mb,
            "gpu_memory_usage_megabytes": self.gpu_memory_mb,
        }
        steps = [round(at_s) for at_s in self.seconds]
        return {
            f"system/{name}": list(dict(zip(steps, column, strict=True)).items())
            for name, column in columns.items()
            if column
        }


def costs(stages: Mapping[str, Sequence[Path]]) -> dict[str, float]:
    """Costs of each stage by name, such as `train_wall_s`, its artifacts' traces put together.

    A stage one of whose traces is missing has no cost: a part of a sum would be read as the whole.
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
    """Resources of a process and all that it started, at one moment."""

    at_s: float
    """Since the start."""
    cpu_s: float
    """Used so far, since long before the start maybe."""
    memory_mb: float
    gpu_memory_mb: float | None


@dataclass
class Telemetry:
    """Samples this process and what it starts during the block, then writes the artifact's trace.

    Only if the block ends well. Samples are taken every second at first; each time that `MOST` are
    full every second one goes and the pace halves. No failure in here, a full disk among them, is
    the block's.
    """

    artifact: str | Path
    every_s: float = 1.0
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
        while not self._end.wait(self.every_s):
            self._sample()
            if len(self._samples) >= MOST:
                del self._samples[1::2]  # the first, which all are measured from, stays
                self.every_s *= 2

    def _sample(self) -> None:
        cpu_s = memory_mb = 0.0
        with suppress(Exception):
            for process in (self._process, *self._process.children(recursive=True)):
                with suppress(psutil.NoSuchProcess):
                    cpu_s += sum(
                        process.cpu_times()[:4]
                    )  # user and system, its own and of its children that ended
                    memory_mb += process.memory_info().rss * MB
            self._samples.append(
                Sample(time.monotonic() - self._start_s, cpu_s, memory_mb, _gpu_memory_mb())
            )
            self._peak_mb = max(self._peak_mb, memory_mb)

    def _trace(self) -> Trace:
        start, *samples = self._samples
        last_sample = samples[-1]
        if len(samples) > 1 and last_sample.at_s - samples[-2].at_s < self.every_s / 2:
            samples.pop()  # too near to the one before for a rate
        rates = [
            (later.cpu_s - earlier.cpu_s) / max(later.at_s - earlier.at_s, 1e-3)
            for earlier, later in pairwise([start, *samples])
        ]
        return Trace(
            wall_s=round(last_sample.at_s, 3),
            cpu_s=round(max(last_sample.cpu_s - start.cpu_s, 0.0), 3),
            peak_memory_mb=round(self._peak_mb, 1),
            seconds=[round(sample.at_s, 3) for sample in samples],
            cpu_percent=[round(max(100 * rate, 0.0), 1) for rate in rates],
            memory_mb=[round(sample.memory_mb, 1) for sample in samples],
            gpu_memory_mb=[round(sample.gpu_memory_mb or 0.0, 1) for sample in samples]
            if last_sample.gpu_memory_mb is not None
            else [],
        )


def _gpu_memory_mb() -> float | None:
    """GPU memory of the stage; None unless it has torch use a GPU already.

    Asking for it here would be what wakes it.
    """
    cuda = getattr(sys.modules.get("torch"), "cuda", None)
    in_use = getattr(cuda, "is_initialized", bool)()  # torch may be half imported
    return cuda.memory_reserved() * MB if cuda and in_use else None
