"""What a query costs on this machine: trained methods and submaps in; milliseconds out.

As in Table III of the SCI paper (METHODS 2.7), a query takes a submap's points to places in two
parts: generation draws the view and computes the descriptor, retrieval ranks the places. Timings
differ from run to run and from machine to machine, so nothing that is compared bit by bit may
depend on them.
"""

import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import distributions
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import InputError
from pipeline.core.schemas import Scans, Submaps
from pipeline.core.settings import Count, within
from pipeline.evaluation.rows import TableRows, number_rows
from pipeline.mapping.gathering import submap_points
from pipeline.matching.ranking import Localizer, Rows
from pipeline.running.telemetry import Trace
from pipeline.studies.models import ModelName

MillisecondsByName = Mapping[str, NDArray[np.float64]]
"""Wall time (query,) in milliseconds."""


class CallTime(NamedTuple):
    """How long one call took."""

    wall_ms: float
    cpu_ms: float


CallTimes = dict[tuple[str, str], CallTime]
"""Of one query, by ("view", its name), ("network", method) and ("method", its name)."""
WARM_UP = 3
"""Calls before the first that counts: they compile, allocate and fill caches."""
PACKAGES = ("numpy", "numba", "torch", "faiss-cpu")
"""Whose versions are recorded."""


@dataclass(frozen=True)
class TimedMethod:
    """A trained method in the parts that are timed."""

    view: str
    """Name of what it looks at; methods that look at the same share the time of drawing it."""
    draw: Callable[[NDArray[np.float64]], NDArray[Any]]
    """Draws the view from points (n, 3) in metres."""
    localize: Localizer
    """Ranks k places for a view."""
    describe: Callable[[Rows], Any] | None = None
    """Computes the descriptor of a view by a network, where the method has one.

    `localize` does so too; it is timed alone besides, to be counted as generation.
    """


@dataclass(frozen=True)
class Latency:
    """Times of some queries, each localized alone by each method."""

    generation: MillisecondsByName
    """By view: from points to the view."""
    retrieval: MillisecondsByName
    """By method: from the view, or the network's descriptor, to its ranking."""
    views: Mapping[str, str]
    """What each method looks at."""
    points: NDArray[np.int64]
    """Points (query,) of each submap."""
    k: int
    """Places ranked."""
    machine: Mapping[str, Any]
    """What it was measured on: `machine_record`."""
    description: MillisecondsByName = field(default_factory=dict)
    """By method whose network makes the descriptor: from the view to it.

    The SCI paper counts it as generation, so it is taken off the retrieval.
    """

    @classmethod
    def measure(
        cls,
        methods: Mapping[str, TimedMethod],
        scans: Scans,
        submaps: Submaps,
        queries: int,
        k: int,
    ) -> Self:
        """Time methods, by name, on some `queries` among the submaps, spread over the sequence.

        All methods answer one query before the next, so that a busy moment of the machine hits all.
        Raises InputError for a sequence without submaps, ConfigError for no queries or places.
        """
        within("latency.queries", queries, Count)
        within("latency.k", k, Count)
        submap_count = len(submaps.scans)
        if not submap_count:
            raise InputError(f"{submaps.path}: no submap to measure with")
        rows = np.unique(np.linspace(0, submap_count - 1, queries).round().astype(np.int64))
        stamps_ns = submaps.stamps_ns[rows, None]
        world_T_anchor = submaps.world_T_anchor[rows, None]
        point_counts: list[int] = []
        query_times: list[CallTimes] = []
        for cloud, stamp_ns, pose in zip(
            clouds(scans, submaps, rows), stamps_ns, world_T_anchor, strict=True
        ):
            if not query_times:
                for _ in range(WARM_UP):
                    _ask(methods, cloud, stamp_ns, pose, k)
            query_times.append(_ask(methods, cloud, stamp_ns, pose, k))
            point_counts.append(len(cloud))
        calls = query_times[0].keys()
        wall_ms = {call: np.array([times[call].wall_ms for times in query_times]) for call in calls}
        cpu_ms = {call: np.array([times[call].cpu_ms for times in query_times]) for call in calls}
        busy = np.sum([*cpu_ms.values()]) / np.sum([*wall_ms.values()])
        views = {name: method.view for name, method in methods.items()}
        generation = {view: wall_ms["view", view] for view in views.values()}
        description = {
            name: wall_ms["network", name] for name in views if ("network", name) in wall_ms
        }
        retrieval = {
            name: np.maximum(wall_ms["method", name] - description.get(name, 0.0), 0.0)
            for name in views
        }
        machine = machine_record(float(busy))
        return cls(generation, retrieval, views, np.array(point_counts), k, machine, description)

    def rows(self) -> TableRows:
        """Rows of medians and 95th percentiles in milliseconds, a method at a time."""
        for method, view in self.views.items():
            parts = {
                "generation": self.generation[view] + self.description.get(method, 0.0),
                "retrieval": self.retrieval[method],
                "query": self.total[method],
            }
            for part, milliseconds in parts.items():
                numbers = {
                    f"{part}_ms": np.median(milliseconds),
                    f"{part}_ms_p95": np.percentile(milliseconds, 95),
                }
                yield from number_rows({"method": method}, "", numbers)

    def record(self) -> dict[str, Any]:
        """Every sample and the machine, as JSON has it."""
        parts = {
            "generation": self.generation,
            "description": self.description,
            "retrieval": self.retrieval,
            "total": self.total,
        }
        samples = {
            part: {name: milliseconds.round(4).tolist() for name, milliseconds in by_name.items()}
            for part, by_name in parts.items()
        }
        settings = {
            "machine": self.machine,
            "views": dict(self.views),
            "k": self.k,
            "points": self.points.tolist(),
        }
        return settings | {"milliseconds": samples}

    def line(self) -> str:
        """The medians of the totals, as one line."""
        medians = ", ".join(
            f"{method} {np.median(milliseconds):.2f} ms"
            for method, milliseconds in self.total.items()
        )
        return f"{medians}; medians of {len(self.points)} queries, from points to places"

    @property
    def total(self) -> MillisecondsByName:
        """Milliseconds (query,) by method, from points to places: generation plus retrieval."""
        return {
            method: self.generation[view]
            + self.description.get(method, 0.0)
            + self.retrieval[method]
            for method, view in self.views.items()
        }


def cost_rows(models: Mapping[ModelName, Path]) -> TableRows:
    """Rows of each model's file size, and of its training's cost where it was trained here."""
    for model, path in models.items():
        columns = {"method": model.method, "variant": model.variant, "seed": model.seed}
        costs = {"model_mb": path.stat().st_size / 1e6}
        if trace := Trace.read(path):
            costs |= {
                "train_cpu_s": trace.cpu_s,
                "train_wall_s": trace.wall_s,
                "train_peak_memory_mb": trace.peak_memory_mb,
            }
        yield from number_rows(columns, "", costs)


def clouds(
    scans: Scans, submaps: Submaps, rows: NDArray[np.int64]
) -> Iterator[NDArray[np.float64]]:
    """Points (n, 3) in metres of some submaps, as a view is drawn from them."""
    for row in rows.tolist():
        yield from submap_points(scans, submaps, slice(row, row + 1))


def machine_record(busy: float) -> dict[str, Any]:
    """Describe this machine as it is now.

    `gpu` is the one that torch has used, empty for none. `load` is the mean number of processes
    that ran or wanted to, over the last minute. `busy` is CPU time over wall time of what was
    measured: above 1 if threads ran side by side, below if others had the processor.
    """
    cuda = getattr(sys.modules.get("torch"), "cuda", None)
    gpu = cuda.get_device_name() if cuda and cuda.is_initialized() else ""
    installed = {
        distribution.name: distribution.version
        for distribution in distributions()
        if distribution.name in PACKAGES
    }
    versions = {
        "Python": platform.python_version(),
        **{name: installed.get(name, "") for name in PACKAGES},
    }
    hardware = {"processor": processor(), "cores": os.cpu_count() or 1, "gpu": gpu}
    return hardware | {
        "load": round(os.getloadavg()[0], 2),
        "busy": round(busy, 2),
        "versions": versions,
    }


def processor() -> str:
    """The processor's name, as far as the system knows it."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text(encoding="utf-8").splitlines() if cpuinfo.is_file() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _ask(
    methods: Mapping[str, TimedMethod],
    cloud: NDArray[np.float64],
    stamp_ns: Any,
    pose: Any,
    k: int,
) -> CallTimes:
    """Draw each view of a cloud (n, 3) once, and localize by each method on its view."""
    times: CallTimes = {}
    images = {}
    for view, draw in {method.view: method.draw for method in methods.values()}.items():
        images[view], times["view", view] = _timed(draw, cloud)
    for name, method in methods.items():
        query = Rows(images[method.view][None], stamp_ns, pose)
        if method.describe:
            _, times["network", name] = _timed(method.describe, query)
        _, times["method", name] = _timed(method.localize, query, k)
    return times


def _timed(call: Callable[..., Any], *arguments: Any) -> tuple[Any, CallTime]:
    """The result of a call, and how long it took."""
    start_s = time.perf_counter()
    start_cpu_s = time.process_time()
    result = call(*arguments)
    wall_ms = 1e3 * (time.perf_counter() - start_s)
    cpu_ms = 1e3 * (time.process_time() - start_cpu_s)
    return result, CallTime(wall_ms, cpu_ms)
