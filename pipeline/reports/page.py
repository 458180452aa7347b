"""report.md: the set-up, both tables, the figures with how to read each, and what the words mean."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.reports import tables
from pipeline.reports.result import Result

SIMULATED = (
    "**Simulated campus, not recorded data.** Every number below was measured in a world that this project made up and swept\n"
    "with a simulated sensor: it shows how the methods compare, not how they would do on a real site.\n"
)
HOW_TO_READ = {
    "precision_recall": "One panel a test sequence: the further a curve stays at the top on its way right, the better; the dot is"
    " the threshold that the model chose without seeing any test sequence.",
    "year": "Each point is one test sequence, at its distance in days from training: a method that lasts stays level; the grey"
    " line is the oracle's top-1, a share of the seen queries and no AUC.",
    "map": "Each point is one query where it was taken: light blue was placed right, dark blue rightly turned away as unseen,"
    " orange turned away although seen, red placed wrong or placed although unseen.",
    "montage": "All maps on one scale: look for errors that stay at one spot through the year, and for streets off the grey.",
    "history": "The weights kept are those of the dashed epoch, where held-out accuracy was highest (of equals, the last);"
    " a held-out loss that turns up while the training loss goes on down is over-fitting.",
}
DEFINITIONS = """\
- A **query** is one submap of a test sequence; it is **seen** if the training sequence has a submap in the same grid cell. An
  unseen cell may touch the training path, where no method can tell it apart.
- **top-n** is the share of the seen queries whose true place is among the first n, rejection ignored; **same heading** counts
  only queries turned at most 45° against the nearest training pose. The **oracle** answers the cell of the geometrically nearest
  training pose: it is wrong only where that pose lies across a cell's border, so it is the mark to reach on strict cells.
- A query is **rejected** as unseen if its novelty reaches a threshold. Accepted with its true place among the first n, it is a
  **hit**; accepted otherwise, be it unseen or seen but misplaced, a **false alarm**; rejected though seen, a **miss**.
- Precision is hits / (hits + false alarms), recall is hits / (hits + misses). A misplaced query is thus *not* held against
  recall, which reaches 1 once everything is accepted, where precision is the share of all queries that are right.
- **AUC** is the area under precision over recall by trapezoids through 200 thresholds, as the SCI authors' code draws it.
  **precision** and **recall** in the table are top-1, at the threshold that each model chose on held-out parts of training.
- **median error** is the distance from a seen query to the first answer, rejection ignored."""


@dataclass(frozen=True)
class Illustration:
    """One figure file of the report."""

    kind: str
    """A key of `HOW_TO_READ`, which says how to read it."""
    path: str
    """Relative to report.md."""
    title: str


def report(
    dataset: str,
    train: str,
    cell_m: float,
    methods: Mapping[str, Mapping[str, object]],
    results: Sequence[Result],
    illustrations: Sequence[Illustration],
    simulated: bool,
) -> str:
    """The whole of report.md; `methods` gives the parameters of each method's yaml."""
    others = len(tables.sequences(results).rows)
    setup = [f"- trained on the one sequence {train}, tested on {others} others", f"- grid cells of {cell_m:g} m"]
    for method, parameters in methods.items():
        settings = ", ".join(f"{name} {value}" for name, value in parameters.items())
        setup.append(f"- method `{method}`" + (f": {settings}" if settings else ""))
    figures = [
        f"### {figure.title}\n\n![{figure.title}]({figure.path})\n\n{HOW_TO_READ[figure.kind]}\n" for figure in illustrations
    ]
    blocks = [
        f"# Localising in {dataset}\n",
        *([SIMULATED] if simulated else []),
        "## Set-up\n",
        "\n".join(setup) + "\n",
        "## Test sequences\n",
        tables.sequences(results).markdown(),
        "## Results\n",
        tables.outcomes(results).markdown(),
        *(["## Figures\n", *figures] if figures else []),
        "## What the words mean\n",
        DEFINITIONS + "\n",
    ]
    return "\n".join(blocks)
