"""What each model of a study costs: the processor's seconds to train it where that was done here, and the time of a query."""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pipeline.reports.table import Table, number
from pipeline.running.telemetry import Trace

HEADER = ("model", "CPU [s] to train", "wall [s]", "peak memory [MB]", "model [MB]", "view [ms]", "ranking [ms]", "query [ms]")


def costs(models: Mapping[str, Path], latency: Path) -> Table:
    """A row a model, variants and seeds too; `latency` is the folder of the same study and grid.

    Medians of a query, from its points to its place, on one thread; a dash where nothing was measured here.
    """
    took, rows = _medians(latency / "latency.json"), []
    for model, path in models.items():
        trace = Trace.read(path)
        used = (trace.cpu_s, trace.wall_s, trace.peak_memory_mb) if trace else (None, None, None)
        trained = (number(value, digits) for value, digits in zip(used, (1, 1, 0), strict=True))
        asked = (number(value, 2) for value in took.get(model, (None, None, None)))
        rows.append((model, *trained, number(path.stat().st_size / 1e6, 1), *asked))
    return Table(HEADER, tuple(rows), words=1)


def _medians(path: Path) -> dict[str, tuple[float, ...]]:
    """Method to the medians of drawing its view, of ranking, and of both, in milliseconds; none where it was not timed."""
    if not path.is_file():
        return {}
    told = json.loads(path.read_text())
    parts, views = told["milliseconds"], told["views"]
    return {
        method: tuple(
            float(np.median(took)) for took in (parts["generation"][view], parts["retrieval"][method], parts["total"][method])
        )
        for method, view in views.items()
    }
