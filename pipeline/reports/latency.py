"""Latency as a page, as plain text, and every sample as json."""

import json
from dataclasses import asdict
from pathlib import Path
from textwrap import fill

import numpy as np

from pipeline.evaluation.timing import WARM_UP, Latency
from pipeline.reports.table import Table

WIDTH = 110
"""Characters in a line of plain text."""
PARTS = ("generation", "retrieval", "total")
PUBLISHED = Table(
    ("published", *PARTS),
    (
        ("SCI", "43.4", "4.7", "48.1"),
        ("Scan Context-50", "41.3", "463.3", "504.6"),
        ("PointNetVLAD", "137.4", "22.0", "159.4"),
        ("M2DP", "75.8", "19.5", "95.3"),
    ),
    words=1,
)
ALONE = " A bird-view is drawn of a map of this one scan, and what matches sequences of them is asked with it alone."
ELSEWHERE = "For context, on other hardware (Matlab, GTX 1080 Ti) and other data: RA-L 2019, Table III, in milliseconds."


def table(latency: Latency) -> Table:
    """Median and 95th percentile in milliseconds, a row a method."""
    rows = []
    for method, view in latency.views.items():
        parts = (latency.generation[view], latency.retrieval[method], latency.total[method])
        rows.append((method, view, *(f"{np.percentile(took, share):.2f}" for took in parts for share in (50, 95))))
    return Table(("method", "looks at", *(heading for part in PARTS for heading in (part, "95 %"))), tuple(rows), words=2)


def line(latency: Latency) -> str:
    """The medians of the totals."""
    told = ", ".join(f"{method} {np.median(took):.2f} ms" for method, took in latency.total.items())
    return f"{told}; medians of {len(latency.points)} queries, from points to places"


def write(latency: Latency, folder: Path, study: str, sequence: str, training: int, simulated: bool) -> None:
    """latency.md, latency.txt and latency.json; `training` is the number of submaps in the database."""
    folder.mkdir(parents=True)
    made = f"simulated {study}" if simulated else study
    title, told, drawn = f"Latency in {made}", [*_told(latency, f"{sequence} of {made}", training), ELSEWHERE], table(latency)
    page = [f"# {title}", *told[:-1], drawn.markdown().strip(), told[-1], PUBLISHED.markdown()]
    wrapped = [fill(part, WIDTH) for part in told]
    plain = [title, *wrapped[:-1], drawn.text().rstrip(), wrapped[-1], PUBLISHED.text()]
    (folder / "latency.md").write_text("\n\n".join(page))
    (folder / "latency.txt").write_text("\n\n".join(plain))
    facts = {"study": study, "sequence": sequence, "simulated": simulated, "training_submaps": training, "k": latency.k}
    samples = {part: {name: took.round(4).tolist() for name, took in getattr(latency, part).items()} for part in PARTS}
    machine, points = asdict(latency.machine), latency.points.tolist()
    (folder / "latency.json").write_text(
        json.dumps({**facts, "machine": machine, "views": dict(latency.views), "points": points, "milliseconds": samples})
    )


def _told(latency: Latency, driven: str, training: int) -> tuple[str, str, str]:
    """What was measured, on what, and how quiet that was."""
    machine = latency.machine
    versions = ", ".join(f"{name} {found}" for name, found in machine.versions.items() if found)
    gpu = f", {machine.gpu}" if machine.gpu else ""
    alone = ALONE if any(view.startswith("birdview") for view in latency.views.values()) else ""
    return (
        f"Milliseconds of wall time, median and 95th percentile of {len(latency.points)} queries spread over {driven}, one at a"
        f" time on one thread, after {WARM_UP} calls to warm up. Generation draws the view from a submap's points"
        f" ({np.median(latency.points):,.0f} in the median); reading them, and gathering those of several sweeps, is not in it."
        f" Retrieval ranks {latency.k} places from {training:,} training submaps.{alone}",
        f"Measured on {machine.processor}, {machine.cores} cores{gpu}; {versions}.",
        f"Load {machine.load:.2f} at the end; CPU time over wall time {machine.busy:.2f}: above 1 threads ran side by side, well"
        " below 1 others had the processor.",
    )
