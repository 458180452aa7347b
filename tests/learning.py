"""For tests of learning: a bar that a score clears by a margin."""

from collections.abc import Callable

Clears = Callable[[float, float], None]
"""The fixture `clears`: a value, and the bar that it lies above."""
