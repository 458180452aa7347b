"""Progress of a command on the terminal: lines, a bar of items, a bar of bytes."""

import sys
import time
from collections.abc import Iterable, Iterator
from typing import Any

from pipeline.core.progress import Item, Progress

LINE_S = 5.0
"""Where there is no terminal, a line of progress is written so often."""


class Lines(Progress):
    """Lines on standard error."""

    def tell(self, line: str) -> None:
        print(f"  {line}", file=sys.stderr, flush=True)


class Bar(Lines):
    """A bar of items on a terminal, lines now and then elsewhere."""

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        from rich.progress import MofNCompleteColumn, TimeRemainingColumn

        yield from _tracked(items, total, 1, what, MofNCompleteColumn(), TimeRemainingColumn())


class Bytes(Lines):
    """A bar of bytes on a terminal, lines now and then elsewhere."""

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


class Scans(Lines):
    """Speed and scans left: a bar on a terminal, a line every tenth of the way where there is none.

    Each line is of what has been done, since work is faster in some stretches than in others; the
    first scan is left out, for it waits for kernels to compile.
    """

    def track(self, items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
        from rich.progress import MofNCompleteColumn, TimeRemainingColumn

        columns = (MofNCompleteColumn(), _speed_column(), TimeRemainingColumn())
        shown_s = first_s = time.monotonic()
        on_terminal = sys.stderr.isatty()
        shown = _tracked(items, total, 1, what, *columns) if on_terminal else items
        for done, item in enumerate(shown, start=1):
            yield item
            now_s = time.monotonic()
            if done == 1:
                first_s = now_s
            elif now_s - shown_s >= LINE_S and not on_terminal:
                shown_s = now_s
                speed = (done - 1) / (now_s - first_s)
                self.tell(
                    f"{what}: {done:,} of {total:,} scans, {speed:.3g} a second, "
                    f"{total - done:,} left: {(total - done) / speed:.0f} s"
                )


def _speed_column() -> Any:
    """A column with the speed of a bar."""
    from rich.progress import ProgressColumn, Task
    from rich.text import Text

    class Speed(ProgressColumn):
        def render(self, task: Task) -> Text:
            return Text(f"{task.speed:.3g} a second" if task.speed else "")

    return Speed()


def _tracked(
    items: Iterable[Item], total: int, advance: int, what: str, *columns: Any
) -> Iterator[Item]:
    """Yield the items under a bar that grows by `advance` with each of them."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn
    from rich.progress import Progress as RichProgress

    console = Console(stderr=True)
    if not console.is_terminal:
        yield from _told(items, total, what)
        return
    shown = (TextColumn(what), BarColumn(24), *columns)
    with RichProgress(*shown, console=console, transient=True) as bar:
        task = bar.add_task(what, total=total * advance)
        for item in items:
            yield item
            bar.update(task, advance=advance)


def _told(items: Iterable[Item], total: int, what: str) -> Iterator[Item]:
    """Yield the items, and print a line on how far they are at most every LINE_S, as to a log."""
    start_s = told_s = time.monotonic()
    for done, item in enumerate(items, start=1):
        yield item
        now_s = time.monotonic()
        if now_s - told_s > LINE_S and done < total:
            left_s = (now_s - start_s) / done * (total - done)
            line = f"  {what}: {done} of {total}, about {left_s:.0f} s left"
            print(line, file=sys.stderr, flush=True)
            told_s = now_s
