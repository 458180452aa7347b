"""A simulated place over fifteen months, and the raw logs that a robot records there.

The logs have the formats of real data sets. Code outside this package must not know that a log is
simulated: the pipeline reads its files like any others. The parameters are set for physical
plausibility only, never in favour of a method.

1. `layout` builds the place: streets and ground, then blocks with buildings and greenery, which
   make a campus; the routes of all sequences; and the events that change the campus over the year.
2. `driving` records one sequence on its day: the drive, the scene of the day, and the scans that a
   ray caster takes of it from the robot.
3. `writers` write the scans and poses as raw logs, one module for each format.

`simulation` puts these steps together; its settings are the yamls of conf/world.
"""

import numpy as np
from numpy.typing import NDArray

import pipeline  # noqa: F401 (it chooses the folder of compiled kernels before any is defined)

Floats = NDArray[np.float64]
"""An array of floats, such as coordinates in metres."""
