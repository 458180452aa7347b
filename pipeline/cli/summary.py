"""The summary that `localize` and `watch` print at the end: verdicts, times, errors, lost scans.

A fix is the pose that was found for a scan, with a verdict that says whether to accept it.
"""

import sys
from collections import Counter
from typing import TYPE_CHECKING

from pipeline.core.errors import LogError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from pipeline.online.inputs import Scan
    from pipeline.online.site import Fix
    from pipeline.posing.verdict import Tolerances

PRINTED_VERDICTS = ("accepted", "near", "ambiguous", "rejected", "no pose")
"""The verdicts in the order in which their counts are printed."""


class Summary:
    """Counts over all scans of a command: verdicts, times, and right fixes among the accepted."""

    def __init__(self, tolerances: "Tolerances") -> None:
        """`tolerances` are those of the site: how far a right pose may be off."""
        self.tolerances = tolerances
        self.verdicts: Counter[str] = Counter()
        """Counts of the localised scans by the verdict on their fix."""
        self.broken: list[str] = []
        """For each scan that could not be read, the reason."""
        self.skipped: Counter[str] = Counter()
        """Counts of the scans that a log or bag leaves out, by reason."""
        self.dropped = 0
        """How many scans of a recording were dropped because newer ones came too fast."""
        self.steps = Counter[bool]()
        """Counts of a tracker's steps: True by odometry, False by constant motion."""
        self._took_ms: list[float] = []
        """The time that each scan took, in their order."""
        self._rightness = Counter[bool]()
        """Counts of the accepted fixes with a known true pose, by whether they are right."""

    def add(self, scan: "Scan", fix: "Fix") -> None:
        """Count one more localised scan."""
        import numpy as np

        self.verdicts[fix.verdict] += 1
        self._took_ms.append(fix.ms)
        if fix.verdict == "accepted" and np.isfinite(scan.world_T_scan).all():
            (right,) = self.tolerances.right(fix.world_T_sensor[None], scan.world_T_scan[None])
            self._rightness[bool(right)] += 1

    def check_any(self, source: str) -> None:
        """Raise LogError if no scan of `source`, as named on the command line, was localised."""
        if not self.verdicts:
            raise LogError(self.broken[0] if self.broken else f"{source}: no scan there")

    def tell(self) -> None:
        """Print the summary on standard error, beside the output."""
        print(self.text(), file=sys.stderr)

    def text(self) -> str:
        """The summary's lines: verdicts and times, then errors, steps and scans left out."""
        lines = [self._verdict_line()]
        if self._rightness:
            right_m, right_deg = self.tolerances.right_within
            lines.append(
                f"of {self._rightness.total()} accepted poses with a known true pose, "
                f"{self._rightness[False]} are over {right_m:g} m or {right_deg:g}° off"
            )
        if self.steps:
            lines.append(
                f"tracked by odometry over {self.steps[True]} steps, by constant motion over "
                f"{self.steps[False]}"
            )
        if self.dropped:
            lines.append(f"{self.dropped} more scans came too fast, and were dropped")
        if left_out := left_out_text(self.skipped):
            lines.append(left_out)
        if self.broken:
            lines.append(f"{len(self.broken)} scans could not be read, the first: {self.broken[0]}")
        return "\n".join(lines)

    def _verdict_line(self) -> str:
        """How many scans got each verdict, and how long they took.

        The first scan also waits for loading and compiling, so its time counts only if there is no
        other scan.
        """
        import numpy as np

        scan_count = self.verdicts.total()
        counts = ", ".join(f"{self.verdicts[verdict]} {verdict}" for verdict in PRINTED_VERDICTS)
        median_ms, slow_ms = np.percentile(self._took_ms[1:] or self._took_ms, (50, 95))
        plural = "" if scan_count == 1 else "s"
        return (
            f"{scan_count} scan{plural}: {counts}; median {median_ms:.0f} ms, "
            f"95 % within {slow_ms:.0f} ms"
        )


def tell_left_out(skipped: Counter[str]) -> None:
    """Print how many scans of a log or bag were left out, by reason, if any were."""
    if left_out := left_out_text(skipped):
        print(f"  {left_out}", file=sys.stderr)


def left_out_text(skipped: Counter[str]) -> str:
    """How many scans of a log or bag were left out, by reason; empty if none were."""
    reasons = ", ".join(f"{reason} ({count})" for reason, count in skipped.most_common() if count)
    return f"{skipped.total()} more were left out: {reasons}" if reasons else ""
