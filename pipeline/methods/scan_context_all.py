"""Scan Context against every training scan at every heading: what ring keys may miss (Kim and Kim,
IROS 2018; METHODS 1.3)."""

from dataclasses import dataclass

from pipeline.matching.shift_method import ShiftMethod


@dataclass(frozen=True)
class ScanContextAll(ShiftMethod):
    """The exhaustive search."""

    view: str = "scan_context"
    least_engaged: float = 0.0
