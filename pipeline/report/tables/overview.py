"""The tables of what a study compares: its models, its test sequences, and what models cost."""

from textwrap import shorten

import numpy as np

from pipeline.report.result import by_sequence
from pipeline.report.selection import NONE, indexed, pick
from pipeline.report.study import Study
from pipeline.report.table import MISSING, Table, count, number, table
from pipeline.report.tables.columns import Column, headings_of
from pipeline.studies import catalogue

# The columns of `costs`: training, the model's size, and the parts of a query's time.
COSTS = (
    Column("CPU [s] to train", "train_cpu_s", 1),
    Column("wall [s]", "train_wall_s", 1),
    Column("peak memory [MB]", "train_peak_memory_mb", 0),
    Column("model [MB]", "model_mb", 1),
    Column("view [ms]", "generation_ms", 2),
    Column("ranking [ms]", "retrieval_ms", 2),
    Column("query [ms]", "query_ms", 2),
    Column("query, 95 % [ms]", "query_ms_p95", 2),
)


def setup(study: Study, longest: int = 400) -> Table:
    """One row per model: what it is, its view, its share of full training, and its size.

    The description of what it is is cut to `longest` characters.
    """
    rows = []
    # The models of the first seed. Those that only add poses to another's answers have no training
    # of their own, so they are not among the trained.
    for model in study.families:
        if model not in study.trained:
            continue
        record = study.models[model]
        what = catalogue.description_of(record.recipe.get("_target_", ""))
        budget = MISSING
        training = "nothing"
        if record.rounds:
            budget = record.recipe.get("budget", MISSING)
            training = f"{record.rounds} rounds"
            if record.best_round is not None:
                training += f", no. {record.best_round + 1} kept"
        rows.append(
            (
                model,
                shorten(what, longest, placeholder=" …") or MISSING,
                record.recipe.get("view", MISSING),
                budget,
                training,
                number(record.megabytes, 1),
            )
        )
    header = ("model", "what it is", "looks at", "budget", "trained", "model [MB]")
    return table("setup", header, rows, text_columns=5)


def sequences(study: Study) -> Table:
    """Table II of the SCI paper: each test sequence's age and how many of its queries are seen.

    A query is seen if training had been at its place. That is counted once by distance and once by
    grid cells; by distance some queries are neither seen nor unseen.
    """
    rows = []
    for name, (result, *_) in by_sequence(study.results).items():
        queries = result.number("cells", "queries")
        seen_by_distance = result.number("distance", "seen")
        unseen_by_distance = result.number("distance", "unseen")
        seen_by_cells = result.number("cells", "seen")
        unseen_by_cells = result.number("cells", "unseen")
        rows.append(
            (
                name,
                count(result.days),
                count(queries),
                count(seen_by_distance),
                count(unseen_by_distance),
                count(queries - seen_by_distance - unseen_by_distance),
                count(seen_by_cells),
                count(unseen_by_cells),
                number(unseen_by_cells / queries if queries else np.nan, 3),
            )
        )
    by_distance = ("distance: seen", "unseen", "not judged")
    by_cells = ("cells: seen", "unseen", "share unseen")
    header = ("sequence", "days", "queries", *by_distance, *by_cells)
    return table("sequences", header, rows)


def costs(study: Study) -> Table | None:
    """One row per model, variants and seeds too: what training cost here, and a query's time.

    None if nothing was measured.
    """
    rows = []
    for model in study.settings.models:
        measured = indexed(pick(study.rows, **model.columns), "number")
        cells = []
        for column in COSTS:
            value, _, _ = measured.get(column.number, NONE)
            cells.append(number(value, column.digits))
        rows.append((model.name, *cells))
    costs_table = table("costs", ("model", *headings_of(COSTS)), rows)
    # A cell's key is the number behind its text, and None behind a dash or a word.
    is_measured = any(cell.key is not None for row in costs_table.rows for cell in row)
    return costs_table if is_measured else None
