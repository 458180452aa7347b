"""`yearloc kernels` compiles all kernels that a level site needs."""

from types import ModuleType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from pipeline.level import beams, field, level_map, refinement, search, sweeps
from pipeline.level.field import Field
from pipeline.level.fix import LevelFixer
from pipeline.level.level_map import Drawing
from pipeline.online.first import localize_level
from tests.level.hall import drive

MODULES = (beams, field, level_map, refinement, search, sweeps)


def kernels(module: ModuleType) -> dict[str, list[Any]]:
    """The signatures that each kernel of a module was compiled for."""
    return {
        name: list(kernel.signatures)
        for name, kernel in vars(module).items()
        if isinstance(kernel, Dispatcher) and kernel.__module__ == module.__name__
    }


def test_a_drive_through_another_building_compiles_nothing_more() -> None:
    localize_level()
    compiled = [kernels(module) for module in MODULES]
    driven = drive(step_m=1.0)
    rows = range(12)
    drawing = Drawing.of([driven.points(row) for row in rows], driven.world_T_sweep[:12])
    left_out = np.zeros(12, bool)
    left_out[3] = True
    gathered = driven.gathered([11], 5.0)[11]
    LevelFixer().fix(Field.of(drawing.level_map(left_out)), gathered)
    assert [kernels(module) for module in MODULES] == compiled
    assert sum(map(len, compiled)) >= 8
