"""Progress of a command on the terminal: lines, a bar of items, a bar of bytes."""

import sys
from collections.abc import Iterable, Iterator
from typing import Any

from pipeline.running.progress import Item, Progress


class Lines(Progress):
    """Lines on standard error."""

    def tell(self, line: str) -> None:
        print(f"  {line}", file=sys.stderr, flush=True)


class Bar(Lines):
    """A bar of items on a terminal."""

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        from rich.progress import MofNCompleteColumn, TimeRemainingColumn

        yield from _tracked(items, total, 1, what, MofNCompleteColumn(), TimeRemainingColumn())


class Bytes(Lines):
    """A bar of bytes on a terminal."""

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        from rich.progress import DownloadColumn, TimeRemainingColumn, TransferSpeedColumn

        from pipeline.fetching.download import CHUNK

        yield from _tracked(
            items,
            total,
            CHUNK,
            what,
            DownloadColumn(),
            TimeRemainingColumn(),
            TransferSpeedColumn(),
        )


def _tracked(
    items: Iterable[Item], total: int, advance: int, what: str, *columns: Any
) -> Iterator[Item]:
    """Yield the items under a bar that grows by `advance` with each of them."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as RichProgress

    console = Console(stderr=True)
    shown = (TextColumn(what), BarColumn(24), *columns)
    with RichProgress(
        *shown, console=console, transient=True, disable=not console.is_terminal
    ) as bar:
        task = bar.add_task(what, total=total * advance)
        for item in items:
            yield item
            bar.update(task, advance=advance)
