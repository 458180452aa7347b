"""Scan Context-50: the nearest of 50 candidates with similar ring keys, at its best heading (Kim
and Kim, IROS 2018; METHODS 1.4).

The search is `ShiftMethod`: it stores the training scans' images, preselects candidates by ring key
(a vector that does not depend on the heading), and compares the candidates at all headings.
"""

from dataclasses import dataclass

from pipeline.core.settings import Count, Share
from pipeline.matching.shift_method import ShiftMethod


@dataclass(frozen=True)
class ScanContext50(ShiftMethod):
    """The authors' settings of the search by columns (`ShiftMethod`)."""

    view: str = "scan_context"
    candidates: Count = 50
    """Number of training scans, nearest by ring key, that are compared at every heading."""
    least_engaged: Share = 0.0
    """As in the authors' comparison, a heading counts however few columns of two scans overlap."""
