"""A recorded building: its second half is localised in a map of the first, by raw odometry."""

from pathlib import Path

import numpy as np

from pipeline.level.field import Field
from pipeline.level.fix import LevelFixer
from pipeline.level.level_map import Drawing
from pipeline.level.validation import Sweeps
from pipeline.level.verdict import OF_SWEEPS, USUAL, USUAL_THRESHOLDS
from pipeline.readers.carmen import Carmen

HALF = 120


def test_seattle_is_found_again(real: Path) -> None:
    log = Carmen().open(real / "carmen", "seattle-corrected")
    sweeps = Sweeps(log.points, log.world_T_scan, log.odom_T_scan)
    mapped = sweeps.part(0, HALF)
    queried = sweeps.part(HALF, HALF + 100)
    hits = [mapped.points(row) for row in range(HALF)]
    field = Field.of(Drawing.of(hits, mapped.world_T_sweep).level_map())
    rows = [10, 40, 70, 99]
    gathered = queried.gathered(rows, 5.0)
    fixes = [LevelFixer().fix(field, gathered[row]).ordered(USUAL.pose) for row in rows]
    poses = np.array([fix.hypotheses[0].world_T_query for fix in fixes])
    assert OF_SWEEPS.right(poses, queried.world_T_sweep[rows]).all()
    accepted = [USUAL.error_probabilities(fix)[0] < USUAL_THRESHOLDS["fix"][0] for fix in fixes]
    assert sum(accepted) >= 3
