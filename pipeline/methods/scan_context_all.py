"""Scan Context against every training scan at every heading (Kim and Kim, IROS 2018; METHODS 1.3).

It is the search of `ShiftMethod` without the preselection by ring keys, which may miss the right
scan.
"""

from dataclasses import dataclass

from pipeline.core.settings import Share
from pipeline.matching.shift_method import ShiftMethod


@dataclass(frozen=True)
class ScanContextAll(ShiftMethod):
    """The exhaustive search: `candidates` stays None, so all training scans are compared."""

    view: str = "scan_context"
    least_engaged: Share = 0.0
    """As in the authors' comparison, a heading counts however few columns of two scans overlap."""
