"""How long a query takes on this machine: trained methods and submaps in; milliseconds out.

As in Table III of the SCI paper (Kim, Park and Kim, RA-L 2019; METHODS 2.7), a query goes from a
submap's points to places in two parts: generation draws the view and computes the descriptor,
retrieval ranks the places. Timings differ from run to run and from machine to machine, so nothing
that is compared bit by bit may depend on them.
"""

import os
import platform
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import distributions
from pathlib import Path
from typing import Any, Self

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
"""Wall times (query,) in milliseconds, of each view or method by name."""


CallTimes = dict[tuple[str, str], tuple[float, float]]
"""Wall and CPU time in milliseconds of all calls of one query.

A call is the drawing of a view ("view", its name), a network's descriptor of it ("network", the
method's name), or all that a method makes of it ("method", its name).
"""
WARM_UP = 3
"""How often the first query runs before it counts: to compile, allocate and fill caches."""
PACKAGES = ("numpy", "numba", "torch", "faiss-cpu")
"""Packages whose versions are recorded."""


@dataclass(frozen=True)
class TimedMethod:
    """A trained method in the parts that are timed."""

    view: str
    """Name of the view that it looks at; methods with the same view share the time to draw it."""
    draw: Callable[[NDArray[np.float64]], NDArray[Any]]
    """Draws the view from points (n, 3) in metres."""
    localize: Localizer
    """Ranks k places for a view."""
    describe: Callable[[Rows], Any] | None = None
    """Computes the descriptor of a view by a network, if the method has one.

    `localize` does so too. It is timed by itself as well, since it counts as generation.
    """


@dataclass(frozen=True)
class Latency:
    """Times of some queries, which each method localizes one by one."""

    generation: MillisecondsByName
    """The times from the points to each view."""
    retrieval: MillisecondsByName
    """The times of each method from the view, or from the network's descriptor, to the ranking."""
    views: Mapping[str, str]
    """Method to its view."""
    points: NDArray[np.int64]
    """(query,) number of points of each submap."""
    k: int
    """Number of places ranked."""
    machine: Mapping[str, Any]
    """The machine that it was measured on (`machine_record`)."""
    description: MillisecondsByName = field(default_factory=dict)
    """The times of each method with a network, from the view to the network's descriptor.

    The SCI paper counts it as generation, so it is subtracted from the retrieval.
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
        """Time methods, by name, on this many `queries`: submaps spread over a sequence.

        All methods answer one query before the next is asked, so that a busy moment of the machine
        slows all of them. Raises InputError for a sequence without submaps, ConfigError if
        `queries` or `k` is no positive number.
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
        of_call = {
            call: np.array([times[call] for times in query_times]).T for call in query_times[0]
        }
        wall_ms = {call: wall for call, (wall, _) in of_call.items()}
        busy = sum(cpu.sum() for _, cpu in of_call.values()) / np.sum([*wall_ms.values()])
        views = {name: method.view for name, method in methods.items()}
        generation = {view: wall_ms["view", view] for view in views.values()}
        description = {
            name: wall_ms["network", name] for name, method in methods.items() if method.describe
        }
        retrieval = {}
        for name in methods:
            without_network_ms = wall_ms["method", name] - description.get(name, 0.0)
            retrieval[name] = np.maximum(without_network_ms, 0.0)
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
        """All times and the machine, for JSON."""
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
        """The times of each method from points to places: generation plus retrieval."""
        total_ms = {}
        for method, view in self.views.items():
            generation_ms = self.generation[view] + self.description.get(method, 0.0)
            total_ms[method] = generation_ms + self.retrieval[method]
        return total_ms


def cost_rows(models: Mapping[ModelName, Path]) -> TableRows:
    """Rows of the size of each model's file, and the cost of its training if it ran here."""
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
    """The points (n, 3) in metres of some submaps, which views are drawn from."""
    for row in rows.tolist():
        yield from submap_points(scans, submaps, slice(row, row + 1))


def machine_record(busy: float) -> dict[str, Any]:
    """Describe this machine as it is now.

    `gpu` is the GPU that torch has used, empty for none. `load` is the mean number of processes
    that ran or waited to run, over the last minute. `busy` is CPU time divided by wall time of what
    was measured: above 1 if threads ran side by side, below 1 if it waited for other processes.
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
    """Draw each view of a cloud (n, 3) once, and let each method localize its view."""
    times: CallTimes = {}
    images = {}
    draw_of_view = {method.view: method.draw for method in methods.values()}
    for view, draw in draw_of_view.items():
        images[view], times["view", view] = _timed(draw, cloud)
    for name, method in methods.items():
        query = Rows(images[method.view][None], stamp_ns, pose)
        if method.describe:
            _, times["network", name] = _timed(method.describe, query)
        _, times["method", name] = _timed(method.localize, query, k)
    return times


def _timed(call: Callable[..., Any], *arguments: Any) -> tuple[Any, tuple[float, float]]:
    """The result of a call, and its wall and CPU time in milliseconds."""
    start_s = time.perf_counter()
    start_cpu_s = time.process_time()
    result = call(*arguments)
    wall_ms = 1e3 * (time.perf_counter() - start_s)
    cpu_ms = 1e3 * (time.process_time() - start_cpu_s)
    return result, (wall_ms, cpu_ms)
