"""A simulated place over fifteen months, and the raw logs that a real robot would record there.

The parameters are set for physical plausibility only, never in favour of a method. Code outside
this package must not know that a log is simulated: the pipeline reads its files.

streets, ground → blocks (buildings, greenery) → campus → plan, routes → events → day
robots (lidar) → drive → raycast → recorder → writers, one per format
"""

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
