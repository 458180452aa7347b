"""The tables of a report, each a selection of the table of results: one module per subject.

A table is made of what was read from the rows of one study: its results on the test days
(`Scores`), a `Comparison` of altered queries, or `Strategy`s of learning further days. Nothing is
measured here: a cell is a number of the table of results with its 95 % interval, or a mean ± a
standard deviation of several. Captions stand in templates/words.yaml, by the kind of the table.
"""

from pipeline.report.tables.cases import (
    BY_CELLS,
    BY_DISTANCE,
    altered,
    every_case,
    near_changes,
    on_sequences,
    over_cell_sizes,
    over_kinds,
    stress,
)
from pipeline.report.tables.columns import DISTANCE_FIRST, Column
from pipeline.report.tables.further import (
    ageing,
    everything,
    headings,
    means,
    novelties,
    paired,
)
from pipeline.report.tables.learning import adopted, asked_days, of_order
from pipeline.report.tables.overview import costs, sequences, setup
from pipeline.report.tables.posed import ANSWERS, pose_table, pose_tables
from pipeline.report.tables.viewpoints import every_heading, over_headings
from pipeline.report.tables.year import (
    MAIN_NUMBERS,
    believed,
    main_number,
    over_days,
    scorecard,
)

__all__ = [
    "ANSWERS",
    "BY_CELLS",
    "BY_DISTANCE",
    "DISTANCE_FIRST",
    "MAIN_NUMBERS",
    "Column",
    "adopted",
    "ageing",
    "altered",
    "asked_days",
    "believed",
    "costs",
    "every_case",
    "every_heading",
    "everything",
    "headings",
    "main_number",
    "means",
    "near_changes",
    "novelties",
    "of_order",
    "on_sequences",
    "over_cell_sizes",
    "over_days",
    "over_headings",
    "over_kinds",
    "paired",
    "pose_table",
    "pose_tables",
    "scorecard",
    "sequences",
    "setup",
    "stress",
]
