"""What tests of learning share: a bar that is cleared by a margin."""

from collections.abc import Callable

Clears = Callable[[float, float], None]
"""The fixture `clears`: a value, and the bar that it lies above."""
