"""report.md: the set-up, the protocols, the tables, the figures with how to read each, and what the words mean."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from pipeline.evaluation.bootstrap import Bootstrap
from pipeline.evaluation.protocols import Distance
from pipeline.reports import findings, tables
from pipeline.reports.result import Result

SIMULATED = (
    "**Simulated, not recorded data.** Every number below was measured in a world that this project made up and swept\n"
    "with a simulated sensor: it shows how the methods compare, not how they would do on a real site.\n"
)
HOW_TO_READ = {
    "precision_recall": "One panel a test sequence: the further a curve stays at the top on its way right, the better; the dot is"
    " the threshold that the model chose without seeing any test sequence.",
    "recall_at": "How often a right place is among the first n, rejection ignored: the mean over the test sequences, each of them"
    " faint. Where the curve still climbs, a second look at the first few places would help.",
    "year": "Each point is one test sequence, at its distance in days from training: a method that lasts stays level. Bands are"
    " 95 % intervals; the grey line is the oracle's recall@1, a share of the seen queries and no AUC.",
    "novelty": "The seen are stacked, right below misplaced; the dark outline is the unseen; each has area 1. The less they"
    " overlap left and right of the dashed threshold, the better the method knows what it does not know.",
    "rejection": "Thresholds were chosen on held-out parts of the training day for the dashed precision. A marker below the line"
    " broke that promise, one high above it gave recall away; a marker that is missing accepted nothing. Bars are 95 % intervals,"
    " long where little was accepted; a very long one is cut.",
    "reliability": "On the diagonal, a confidence of 80 % is right 8 times of 10; red lines show how far off a bin is, and their"
    " mean length over the queries is the expected calibration error (ECE). Below: how many queries were answered so surely.",
    "matches": "Each row is one query; heights are coloured from blue (0 m) to red (15 m), near rings at the bottom. Right ones"
    " are picked over the year; wrong ones (red) are those that looked least new, at most one a stretch of path: *next cell* is"
    " wrong by cells alone, *misplaced* and *unseen* by distance. Training images are rolled to where they look most like the"
    " query.",
    "map": "By cells. Each point is one query where it was taken: light blue was placed right, dark blue rightly turned away as"
    " unseen, orange turned away although seen, red placed wrong or placed although unseen.",
    "montage": "By cells. All maps on one scale: look for errors that stay at one spot through the year, and for streets off the"
    " grey. Red along the training path is often the neighbouring cell: right by distance.",
    "history": "The weights kept are those of the dashed epoch, where held-out accuracy was highest (of equals, the last);"
    " a held-out loss that turns up while the training loss goes on down is over-fitting.",
}
PROTOCOLS = """\
Every number is by one of two protocols, and says which.

- **By cells**, the papers': a query is *seen* if training has a submap in its grid cell of {cell_m:g} m, else *unseen*; an
  answer is right if it is that cell. Recall is hits / (hits + misses): a misplaced query is a false alarm and not held against
  recall, which so reaches 1 once everything is accepted. Cells have borders: an answer 3 m off can be wrong, and an unseen cell
  that touches the training path cannot be told from it by any method.
- **By distance**: *seen* if a training pose is nearer than {seen_m:g} m, *unseen* if none is within {unseen_m:g} m, and not
  judged between; an answer is right within {correct_m:g} m. Recall is the usual one, hits / all seen: a misplaced query counts
  against it.
- The **oracle** answers the place of the nearest training pose: by cells the mark to reach, by distance 1 by construction.
"""
DEFINITIONS = """\
- **recall@n** is the share of the seen queries with a right answer among the first n, rejection ignored.
- A query is **rejected** as unseen if its novelty reaches a threshold. Accepted with a right answer it is a **hit**; accepted
  otherwise, be it unseen or seen but misplaced, a **false alarm**; rejected though seen, a **miss**. Precision is
  hits / (hits + false alarms).
- **AUC** is the area under precision over recall by trapezoids through 200 thresholds, as the SCI authors' code draws it; the
  **exact** one goes through every novelty that was met. **F1max** is the best harmonic mean of the two along that curve,
  **R@99%P** the largest recall at a precision of 99 % or more. By cells all of these leave misplaced queries out of recall.
- **AUROC** is the chance that an unseen query looks newer than a seen one: .5 is guessing.
- **precision** and **recall** in the tables are at the threshold that each model chose on held-out parts of training.
- **error** is the median distance from a seen query to the first answer, rejection ignored.
- Intervals in brackets hold 95 % of {resamples:,} resamples of the query path in blocks of {block_m:g} m, since neighbours fail
  together. A path of few blocks makes them a little too narrow, and they know of chance along the path only, not of another seed
  or another world.
"""
KINDS = """\
Means over the test sequences, of precision over those where anything was accepted. Thresholds were chosen on held-out parts of
training, by cells.
"""
WORDS = """\
In brackets: 95 % intervals. oracle: the nearest training pose's place. AUC: area under precision over recall; precision and
recall: at the model's own threshold; R@99%P: recall at 99 % precision; AUROC: unseen told from seen; error: median of the seen.
"""


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
    distance: Distance,
    bootstrap: Bootstrap,
) -> str:
    """The whole of report.md; `methods` gives the parameters of each method's yaml."""
    others = len(tables.sequences(results).rows)
    setup = [f"- trained on the one sequence {train}, tested on {others} others", f"- grid cells of {cell_m:g} m"]
    for method, parameters in methods.items():
        settings = ", ".join(f"{name} {value}" for name, value in parameters.items() if not name.startswith("_"))
        setup.append(f"- method `{method}`" + (f": {settings}" if settings else ""))
    blocks = [
        f"# Localising in {dataset}\n",
        *([SIMULATED] if simulated else []),
        "## Set-up\n",
        "\n".join(setup) + "\n",
        "## Two protocols\n",
        PROTOCOLS.format(cell_m=cell_m, **vars(distance)),
        "## Test sequences\n",
        tables.sequences(results).markdown(),
        "## Results by cells\n",
        tables.outcomes(results, "cells").markdown(),
        "## Results by distance\n",
        tables.outcomes(results, "distance").markdown(),
        "## Kinds of novelty\n",
        KINDS,
        *(block for protocol in ("cells", "distance") for block in _kinds(results, protocol)),
        *(["## Figures\n", *map(_figure, illustrations)] if illustrations else []),
        "## What the words mean\n",
        DEFINITIONS.format(**vars(bootstrap)),
    ]
    return "\n".join(blocks)


def text(head: str, results: Sequence[Result], cell_m: float, distance: Distance) -> str:
    """results.txt: both tables for a terminal."""
    cells = (
        f"By cells of {cell_m:g} m: seen = training was in the query's cell, right = that cell;"
        " a misplaced query does not lower recall."
    )
    metres = (
        f"By distance: seen = a training pose within {distance.seen_m:g} m, right = within {distance.correct_m:g} m;"
        " a misplaced query lowers recall."
    )
    first, second = (tables.outcomes(results, protocol).text() for protocol in ("cells", "distance"))
    return "\n".join((f"{head}\n", cells, first, metres, second, WORDS))


def _kinds(results: Sequence[Result], protocol: str) -> list[str]:
    told = "\n".join(f"- {sentence}" for sentence in findings.novelties(results, protocol))
    return [f"### By {protocol}\n", tables.novelties(results, protocol).markdown(), *([told + "\n"] if told else [])]


def _figure(figure: Illustration) -> str:
    return f"### {figure.title}\n\n![{figure.title}]({figure.path})\n\n{HOW_TO_READ[figure.kind]}\n"
