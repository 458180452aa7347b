"""Drawing the views of a block of submaps."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.store import Artifact

BLOCK = 64


@dataclass(frozen=True)
class Drawing:
    """Draws rows of a submaps artifact: called with a first row and the row after the last."""

    scans: Artifact
    rows: NDArray[np.int64]
    """(submap,) the scan that makes each."""
    view: Callable[[NDArray[np.float64]], NDArray[np.float32]]

    def __len__(self) -> int:
        return len(self.rows)

    def __call__(self, start: int, stop: int) -> NDArray[np.float32]:
        """Images (stop − start, …) of these submaps; their points are read in one slice."""
        rows = self.rows[start:stop]
        offsets = np.asarray(self.scans["offsets"][rows[0] : rows[-1] + 2])
        points = np.asarray(self.scans["points"][offsets[0] : offsets[-1]])
        grain_m = float(self.scans.attrs["grain_m"])
        spans = [(offsets[row - rows[0]] - offsets[0], offsets[row - rows[0] + 1] - offsets[0]) for row in rows]
        return np.stack([self.view(points[a:b] * grain_m) for a, b in spans])
