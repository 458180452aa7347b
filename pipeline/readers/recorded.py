"""Checks the logs of a recorded data set for the stage `logs`, and lists their scans.

For a simulated world the same stage writes the logs; recorded ones exist already.
"""

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
from pipeline.readers.splits import open_split


@dataclass(frozen=True)
class Recorded:
    """A data set on disk, with the same methods as a `Simulation` of a world."""

    reader: Reader
    root: str
    """The folder of the data set."""
    events: str | None = None
    """A csv of the changes on site after training, in the format of `formats.changes`; None: no
    changes are recorded."""

    def record(self, sequence: str, folder: Path, compute: Compute, watch: Progress) -> str:
        """Read the log of `sequence` and write folder/inventory.csv; returns a line of counts.

        The csv has a row per scan with a digest of its poses and points, so it changes whenever the
        log changes. Raises LogError for a log that cannot be opened; scans that cannot be read are
        only counted.
        """
        log = open_split(self.reader, Path(self.root), sequence)
        skipped = Counter(log.skipped)
        rows = ["stamp_ns,points,digest\n"]
        stamps = watch.track(log.stamps_ns.tolist(), len(log.stamps_ns), "check")
        for row, stamp in enumerate(stamps):
            try:
                points = log.points(row)
            except LogError:
                skipped["unreadable scan"] += 1
                continue
            arrays = (*log.poses(row), points)
            data = b"".join(np.ascontiguousarray(array).data for array in arrays)
            rows.append(f"{stamp},{len(points)},{sha256(data).hexdigest()[:16]}\n")
        folder.mkdir(parents=True)
        (folder / "inventory.csv").write_text("".join(rows), encoding="utf-8")
        skipped_text = "".join(
            f", {count} skipped ({reason})" for reason, count in sorted(skipped.items())
        )
        return "; ".join(
            [f"{len(rows) - 1} scans found below {self.root}{skipped_text}", *log.notes]
        )

    def changes(self, train: str, sequence: str) -> list[Change]:
        """The changes on site that are visible on the day of `sequence` but not on that of `train`.

        Raises LogError for a bad csv or bad logs.
        """
        if self.events is None:
            return []
        root = Path(self.root)
        train_ns = open_split(self.reader, root, train).stamps_ns[0]
        sequence_ns = open_split(self.reader, root, sequence).stamps_ns[0]
        return visible(read_changes(Path(self.events)), days_between(train_ns, sequence_ns))
