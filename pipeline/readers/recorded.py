"""Logs of a recorded data set: they exist, so the stage `logs` only checks and lists them."""

from collections import Counter
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from pipeline.core.compute import Compute
from pipeline.core.errors import LogError
from pipeline.core.frames import days_between
from pipeline.core.progress import Progress
from pipeline.formats.changes import Change, read_changes, visible
from pipeline.readers.log import Reader
from pipeline.readers.parts import open_part


@dataclass(frozen=True)
class Recorded:
    """A data set on disk; has the methods of a Simulation."""

    reader: Reader
    root: str
    events: str | None = None
    """A csv of the changes on site after training, in the format of `formats.changes`; None: not
    recorded."""

    def record(self, sequence: str, folder: Path, compute: Compute, watch: Progress) -> str:
        """Open the log below `root` and write folder/inventory.csv; returns a line with the counts.

        The csv has a line per scan with a digest of its poses and points, so that it changes
        whenever the log does. Raises LogError for a log that cannot be opened; scans that cannot be
        read are counted.
        """
        log = open_part(self.reader, Path(self.root), sequence)
        skipped = Counter(log.skipped)
        rows = ["stamp_ns,points,digest\n"]
        for row, stamp in enumerate(
            watch.track(log.stamps_ns.tolist(), len(log.stamps_ns), "check")
        ):
            try:
                points = log.points(row)
            except LogError:
                skipped["unreadable scan"] += 1
                continue
            data = b"".join(np.ascontiguousarray(part).data for part in (*log.poses(row), points))
            rows.append(f"{stamp},{len(points)},{sha256(data).hexdigest()[:16]}\n")
        folder.mkdir(parents=True)
        (folder / "inventory.csv").write_text("".join(rows), encoding="utf-8")
        left_out = "".join(
            f", {count} skipped ({reason})" for reason, count in sorted(skipped.items())
        )
        return "; ".join([f"{len(rows) - 1} scans found below {self.root}{left_out}", *log.notes])

    def changes(self, train: str, sequence: str) -> list[Change]:
        """The changes visible on the day of `sequence` but not of `train`.

        Raises LogError for a bad csv or bad logs.
        """
        if self.events is None:
            return []
        root = Path(self.root)
        trained, driven = (
            open_part(self.reader, root, name).stamps_ns[0] for name in (train, sequence)
        )
        return visible(read_changes(Path(self.events)), days_between(trained, driven))
