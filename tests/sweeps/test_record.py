"""The record of a sweep's job is plain JSON, and is read with the numbers it was written with."""

import json
import math
from pathlib import Path

from pipeline.evaluation.rows import row
from pipeline.sweeps.record import Record, read

ROWS = [
    {"sequence": "may", "days": 10.0, "seed": 0, **row("auc_top1", "cells", 0.5)},
    {"sequence": "may", "days": 10.0, "seed": 0, **row("threshold", "cells", math.inf)},
    {
        "sequence": "june",
        "days": math.nan,
        "seed": 0,
        **row("auc_top1", "cells", math.nan, 0.25, 0.75),
    },
]


def refuse(constant: str) -> float:
    raise AssertionError(f"{constant} is no JSON")


def test_a_record_is_json_and_comes_back_with_its_numbers(tmp_path: Path) -> None:
    for number in (1, 0):
        Record(number, {"grid.cell_m": "5"}, "campus", True, "sci", rows=ROWS).write(tmp_path)
    Record(2, {}, "campus", True, "sci", error="refused").write(tmp_path)
    content = json.loads((tmp_path / "0.json").read_text(), parse_constant=refuse)
    assert [row["value"] for row in content["rows"]] == [0.5, None, None]
    assert content["rows"][0]["low"] is None  # a number without an interval
    first, second, failed = read(tmp_path)
    assert (first.number, second.number, failed.error, failed.rows) == (0, 1, "refused", ())
    assert first.values("cells", "auc_top1") == [0.5]
    assert math.isnan(first.rows[2]["days"])
    assert (first.rows[2]["low"], first.rows[2]["high"]) == (0.25, 0.75)
