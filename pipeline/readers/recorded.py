"""The real world's logs: already recorded, so there is nothing to make, only to check and to list."""

from dataclasses import dataclass
from pathlib import Path

from pipeline.compute import Compute
from pipeline.readers.log import Reader
from pipeline.watch import Watch


@dataclass(frozen=True)
class Recorded:
    """A data set on disk; stands where a simulation would."""

    reader: Reader
    root: str

    def record(self, sequence: str, folder: Path, compute: Compute, watch: Watch) -> str:
        """Open the log below `root` and write what it holds into folder/inventory.csv; says how much that is.

        Raises LogError for what cannot be read.
        """
        log = self.reader.open(Path(self.root), sequence)
        rows = "".join(
            f"{stamp},{len(log.points(row))}\n"
            for row, stamp in enumerate(watch.track(log.stamps_ns.tolist(), len(log.stamps_ns), "check"))
        )
        folder.mkdir(parents=True)
        (folder / "inventory.csv").write_text("stamp_ns,points\n" + rows)
        left_out = "".join(f", {count} skipped ({reason})" for reason, count in sorted(log.skipped.items()))
        return "; ".join([f"{len(log.stamps_ns)} scans found below {self.root}{left_out}", *log.notes])
