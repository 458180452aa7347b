"""Shows the progress of a command: a bar on a terminal, elsewhere a line every few seconds.

The classes differ in what they count: items, bytes, or scans with their speed.
"""

import sys
import time
from collections.abc import Iterable, Iterator
from typing import Any

from pipeline.core.progress import Item, Progress

LINE_S = 5.0
"""Seconds between two lines of progress if the output is no terminal."""


class Lines(Progress):
    """Prints lines on standard error, without a bar."""

    def tell(self, line: str) -> None:
        print(f"  {line}", file=sys.stderr, flush=True)


class Bar(Lines):
    """Shows a bar of items, with the time left."""

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        from rich.progress import MofNCompleteColumn, TimeRemainingColumn

        columns = (MofNCompleteColumn(), TimeRemainingColumn())
        yield from _tracked(items, total, what, *columns)


class Bytes(Lines):
    """Shows a bar of bytes, with the speed and the time left; an item is a chunk."""

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        from rich.progress import DownloadColumn, TimeRemainingColumn, TransferSpeedColumn

        from pipeline.fetching.download import CHUNK

        columns = (DownloadColumn(), TimeRemainingColumn(), TransferSpeedColumn())
        yield from _tracked(items, total, what, *columns, advance=CHUNK)


class Scans(Lines):
    """Shows how many scans are done and left, and the speed.

    The speed is the mean of all scans but the first, which waits for kernels to compile.
    """

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        if sys.stderr.isatty():
            from rich.progress import MofNCompleteColumn, TimeRemainingColumn

            columns = (MofNCompleteColumn(), _speed_column(), TimeRemainingColumn())
            yield from _tracked(items, total, what, *columns)
        else:
            yield from self._with_lines(items, total, what)

    def _with_lines(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        """Yield the items, and print a line every LINE_S."""
        printed_s = first_s = time.monotonic()
        for n_done, item in enumerate(items, start=1):
            yield item
            now_s = time.monotonic()
            if n_done == 1:
                first_s = now_s
            elif now_s - printed_s >= LINE_S:
                printed_s = now_s
                speed = (n_done - 1) / (now_s - first_s)  # scans a second, without the first
                n_left = total - n_done
                self.tell(
                    f"{what}: {n_done:,} of {total:,} scans, {speed:.3g} a second, "
                    f"{n_left:,} left: {n_left / speed:.0f} s"
                )


def _speed_column() -> Any:
    """A column of rich's bar that shows the speed."""
    from rich.progress import ProgressColumn, Task
    from rich.text import Text

    class Speed(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(f"{task.speed:.3g} a second" if task.speed else "")

    return Speed()


def _tracked(
    items: Iterable[Item], total: int, what: str, *columns: Any, advance: int = 1
) -> Iterator[Item]:
    """Yield the items, and show them in a bar that advances by `advance` with each item.

    The bar shows the text `what`, then rich's `columns`. Without a terminal, lines are printed
    instead.
    """
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as RichProgress

    console = Console(stderr=True)
    if not console.is_terminal:
        yield from _tracked_by_lines(items, total, what)
        return
    all_columns = (TextColumn(what), BarColumn(24), *columns)
    with RichProgress(*all_columns, console=console, transient=True) as bar:
        task = bar.add_task(what, total=total * advance)
        for item in items:
            yield item
            bar.update(task, advance=advance)


def _tracked_by_lines(items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
    """Yield the items, and print a line on how many are done at most every LINE_S."""
    start_s = printed_s = time.monotonic()
    for n_done, item in enumerate(items, start=1):
        yield item
        now_s = time.monotonic()
        if now_s - printed_s > LINE_S and n_done < total:
            left_s = (now_s - start_s) / n_done * (total - n_done)
            line = f"  {what}: {n_done} of {total}, about {left_s:.0f} s left"
            print(line, file=sys.stderr, flush=True)
            printed_s = now_s
