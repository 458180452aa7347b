"""Scan Context-50: the nearest of the 50 whose rings look alike, at its best heading (Kim and Kim,
IROS 2018; METHODS 1.4)."""

from dataclasses import dataclass

from pipeline.core.settings import Count
from pipeline.matching.shift_method import ShiftMethod


@dataclass(frozen=True)
class ScanContext50(ShiftMethod):
    """The authors' place recognition."""

    view: str = "scan_context"
    candidates: Count = 50
    least_engaged: float = 0.0
