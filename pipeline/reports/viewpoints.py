"""Paper 2's figures and tables (Fig. 5 to 7): how methods fare when a place is met from another heading."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from numpy.typing import NDArray

from pipeline.errors import InputError
from pipeline.evaluation.viewpoints import Judged
from pipeline.reports import viewpoint_figures, viewpoint_learning, viewpoint_page
from pipeline.reports.illustration import Illustration
from pipeline.reports.learned import Learned
from pipeline.reports.style import save

Pictures = tuple[NDArray[Any], NDArray[Any]]
"""Images (h, side, side) of one place, a turn's h even parts counter-clockwise, and what the networks made of them, 0 to 255."""


def write(
    folder: Path,
    name: str,
    simulated: bool,
    results: Mapping[tuple[str, str], Judged | Sequence[Judged]],
    models: Mapping[str, Learned | Sequence[Learned]],
    pictures: Mapping[str, Pictures],
    mapped: Figure | None = None,
) -> list[Path]:
    """Write viewpoints.md, its figures, and a table for a terminal into `folder`; returns the files.

    `results` holds what was judged by (method, sequence), `models` and `pictures` go by method; a sequence of models or
    judgements is one a seed. Methods that learn nothing have no pictures. `mapped` is reports.mapping's Fig. 2. Raises
    InputError for no results.
    """
    if not results:
        raise InputError("a report on viewpoints needs at least one judged sequence")
    judged = {key: [one] if isinstance(one, Judged) else list(one) for key, one in results.items()}
    learned = {method: [one] if isinstance(one, Learned) else list(one) for method, one in models.items()}
    folder.mkdir(parents=True, exist_ok=True)
    written, illustrations = [], []
    ahead = [("mapping", "viewpoints_mapping", "What is looked at (Fig. 2)", mapped)] if mapped else []
    for kind, stem, title, fig in (*ahead, *_figures(judged, learned, pictures, simulated)):
        written.append(save(fig, folder / f"{stem}.svg"))
        illustrations.append(Illustration(kind, f"{stem}.svg", title))
    page = folder / "viewpoints.md"
    page.write_text(viewpoint_page.page(name, simulated, judged, learned, illustrations))
    table = folder / "viewpoints.txt"
    table.write_text(viewpoint_page.text(name, simulated, judged))
    return [page, table, *written]


def _figures(
    judged: Mapping[tuple[str, str], Sequence[Judged]],
    learned: Mapping[str, Sequence[Learned]],
    pictures: Mapping[str, Pictures],
    simulated: bool,
) -> list[tuple[str, str, str, Figure]]:
    """Kind, file name, title and figure."""
    found = []
    for sequence in dict.fromkeys(sequence for _, sequence in judged):
        group = {method: seeds for (method, where), seeds in judged.items() if where == sequence}
        title = f"Precision and recall on {sequence} (Fig. 5)"
        fig = viewpoint_figures.precision_recall(group, sequence, simulated)
        found.append(("curves", f"viewpoints_precision_recall_{sequence}", title, fig))
    found.append(("indices", "viewpoints_indices", "Heading by heading (Fig. 6)", viewpoint_figures.indices(judged, simulated)))
    if pictures:
        fig = viewpoint_learning.reconstructions(pictures, simulated)
        found.append(("reconstructions", "viewpoints_reconstructions", "What the codes keep (Fig. 7)", fig))
    curves = {method: [one.curves for one in seeds] for method, seeds in learned.items()}
    if drawn := viewpoint_learning.collapse(curves, simulated):
        found.append(("collapse", "viewpoints_collapse", "Whether the codes collapse", drawn))
    return found
