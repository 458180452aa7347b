"""What a person is shown while a command works."""

import sys
from collections.abc import Iterable, Iterator

from pipeline.running.progress import Item, Progress


class Lines(Progress):
    """Lines on standard error."""

    def tell(self, line: str) -> None:
        print(f"  {line}", file=sys.stderr, flush=True)


class Bytes(Lines):
    """A bar of bytes on a terminal."""

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        from rich.console import Console
        from rich.progress import BarColumn, DownloadColumn, TextColumn, TimeRemainingColumn, TransferSpeedColumn
        from rich.progress import Progress as RichProgress

        from pipeline.fetching.download import CHUNK

        console = Console(stderr=True)
        columns = (TextColumn(what), BarColumn(24), DownloadColumn(), TransferSpeedColumn(), TimeRemainingColumn())
        with RichProgress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
            task = bar.add_task(what, total=total * CHUNK)
            for item in items:
                yield item
                bar.update(task, advance=CHUNK)
