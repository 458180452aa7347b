"""Packs a level site, for a level 2-D laser: from a Nav2 map, or from a training day's sweeps.

The map, its verdict (level/verdict.py) and what they were made of are written into one site file.
"""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.core.datum import Datum
from pipeline.core.errors import ArtifactError, InputError
from pipeline.core.precisions import JUDGED_PRECISION
from pipeline.core.progress import Progress
from pipeline.core.schemas import Scans
from pipeline.formats import nav2_map
from pipeline.level.day import LevelDay, sweeps_basis
from pipeline.level.fix import LevelFixer
from pipeline.level.level_map import LevelMap
from pipeline.level.sweeps import OVER_M
from pipeline.level.validation import LevelValidation, Sweeps
from pipeline.level.verdict import NO_EVIDENCE, verdict_of
from pipeline.online import site_file
from pipeline.online.site_json import (
    LevelDescription,
    LevelSettings,
    Provenance,
    Sensor,
)
from pipeline.posing.learned_verdict import Learned
from pipeline.posing.verdict import Verdict

UNSEEN_SHARE = 0.2
"""The expected share of queries from places that the map does not have."""
LEVEL_VERSIONS = ("numpy", "numba", "scipy", "safetensors")
"""Packages whose versions a site records."""
CARMEN = {"_target_": "pipeline.readers.carmen.Carmen"}
"""The reader of logs that are localised in the site of a Nav2 map; bags need no reader."""


def pack_map(map_path: Path, out: Path, datum: Datum | None = None) -> str:
    """Write the site of a Nav2 map; returns a line on its content.

    Its verdict has the usual thresholds, since a map has no sweeps to validate them with. Raises
    ArtifactError for a file that is not a map of a building.
    """
    grid = nav2_map.read(map_path)
    try:
        level_map = LevelMap(grid.occupancy, grid.resolution_m, grid.origin)
    except InputError as error:
        raise ArtifactError(f"{map_path}: {error}") from None
    digest = hashlib.md5(map_path.read_bytes(), usedforsecurity=False).hexdigest()
    verdict = verdict_of(NO_EVIDENCE, UNSEEN_SHARE)
    return _write(
        out, map_path.stem, False, level_map, verdict, CARMEN, map_path.name, digest, datum
    )


def pack_sweeps(
    name: str,
    out: Path,
    scans: Scans,
    train: str,
    simulated: bool,
    reader: Mapping[str, Any],
    progress: Progress,
    verdict: Path | None = None,
    datum: Datum | None = None,
) -> str:
    """Write the site of a training day's level sweeps; returns a line on its content.

    `verdict` is the artifact that the stage `poses` wrote; without it, the verdict is learned here
    from validation stretches of the day.
    """
    sweeps = Sweeps.of(scans, is_posed=True)
    learned = Learned.read(verdict, sweeps_basis(sweeps, UNSEEN_SHARE))
    activity = "draw" if learned else "localise validation stretches of"
    progress.tell(f"{activity} {len(sweeps.world_T_sweep)} sweeps")
    day = LevelDay.of(sweeps, UNSEEN_SHARE, LevelValidation(), learned)
    return _write(out, name, simulated, day.level_map, day.verdict, reader, train, None, datum)


def _write(
    out: Path,
    name: str,
    simulated: bool,
    level_map: LevelMap,
    verdict: Verdict,
    reader: Mapping[str, Any],
    source: str,
    digest: str | None,
    datum: Datum | None,
) -> str:
    """Write a site file; returns a line on its content.

    `source` is the map's file or the training sequence, `digest` the map's md5.
    """
    lift_m = float(reader.get("lift_m", 0.0))
    description = LevelDescription(
        name=name,
        simulated=simulated,
        level=LevelSettings(level_map.cell_m, level_map.origin, OVER_M, LevelFixer()),
        verdict=verdict,
        reader=dict(reader),
        # the sensors of level sweeps are not compared
        sensor=Sensor(lift_m, None, None, None, None, None, ()),
        provenance=Provenance.of(source, {"map": digest}, LEVEL_VERSIONS),
        datum=datum,
    )
    arrays = {"occupancy": level_map.occupancy}
    site_file.write(out, site_file.LevelParts(description, arrays))
    target_precisions = ", ".join(map(str, description.verdict.reachable)) or "none"
    blocks = verdict.validation_blocks
    kept = verdict.kept_words(JUDGED_PRECISION)
    checked = f"checked on {blocks} validation blocks" if blocks else "not checked in this one"
    return (
        f"{out}: level, {level_map.free_m2:,.0f} m² of free space in cells of "
        f"{level_map.cell_m:g} m, {out.stat().st_size / 1e6:.1f} MB; target precisions "
        f"{target_precisions}, learned in three recorded buildings and {checked}"
        f"{f'; {kept}' if kept else ''}"
    )
