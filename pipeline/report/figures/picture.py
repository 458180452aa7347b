"""The moving picture of one test day: the robot drives, and each answer stays as a dot.

The share of right answers grows beside it.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import NDArray

from pipeline.core.progress import Progress
from pipeline.report.figures import animation
from pipeline.report.figures.drive import NOT_COUNTED, RIGHT, WRONG, Drive
from pipeline.report.figures.maps import scale_bar
from pipeline.report.figures.style import SIMULATED, dot, styled
from pipeline.studies.colours import PALETTE
from pipeline.views.scan_context import colours, quantize

WIDTH_PX = 900
HEIGHT_PX = 580
DPI = 100
RIGHT_PX = WIDTH_PX - 20  # where the right column ends
FRAMES = 130
"""At most so many."""
TINTS = {RIGHT: PALETTE[0], WRONG: PALETTE[1], NOT_COUNTED: "#C4C4C4"}
MARKS: Any = {NOT_COUNTED: ("o", 3.6), RIGHT: ("o", 5.0), WRONG: ("X", 7.5)}
"""Blue and vermilion, which colour-blind readers tell apart, and markers besides, of so many
points; wrong ones lie on top."""
PATH = "#8C8C8C"
WALL = "#DAD3C5"
INK = "#222222"
GREY = "#6E6E6E"
HEIGHTS = colours("jet")[np.linspace(0, 255, 16).round().astype(int)]
"""The colours (level, 3) of heights in a view, fewer than in other figures."""
SIZE = 10.5  # of words, in points


def write(drive: Drive, path: Path, progress: Progress) -> tuple[int, int]:
    """Write the picture as .gif, .webp or (animated) .png; returns its frames and bytes.

    Same artifacts, same bytes.

    Raises ConfigError for another ending.
    """
    frame_queries = animation.spread(len(drive.xy_m), FRAMES)
    table = animation.palette((*TINTS.values(), PATH, WALL, INK, GREY), HEIGHTS)
    return animation.save(
        progress.track(frames(drive, frame_queries), len(frame_queries), "frames"), path, table
    )


def frames(drive: Drive, frame_queries: NDArray[np.int64]) -> Iterator[NDArray[np.uint8]]:
    """Draw a frame (height, width, 3) for each of `frame_queries`."""
    canvas = Canvas(drive)
    pairs = drive.pairs(drive.views, frame_queries) if drive.views else None
    for number, query in enumerate(frame_queries.tolist()):
        yield canvas.drawn(query, None if pairs is None else pairs[number])


class Canvas:
    """The figure, and the parts of it that change from frame to frame."""

    @styled
    def __init__(self, drive: Drive) -> None:
        """Draw the parts that stay."""
        self.drive = drive
        self.figure = Figure((WIDTH_PX / DPI, HEIGHT_PX / DPI), dpi=DPI)
        self.agg: Any = FigureCanvasAgg(self.figure)
        fits = min(1.0, 56 / len(drive.title))  # a long title is smaller
        self.text(16, 12, drive.title, size=13.5 * fits, weight="bold")
        self.text(16, 42, f"{drive.where}, method {drive.model}", color=GREY)
        if drive.simulated:
            self.text(RIGHT_PX, 15, SIMULATED, style="italic", color=GREY, ha="right")
        self._map(self.axes(12, 70, 490, 430))
        self.images = []
        caption = "the answer to its view"
        caption_px = 180
        top = 210
        if drive.views:
            self.text(520, 72, "the robot's view: 360° across, distance down")
            self.images = [self._view(y_px) for y_px in (94, 250)]
            caption = "the training view it matches"
            caption_px = 228
            top = 380
        self.text(520, caption_px, caption)
        self.off = self.text(RIGHT_PX, caption_px, "", weight="bold", ha="right")
        self.number = self.text(520, top, "", size=20, weight="bold")
        self.counts = self.text(RIGHT_PX, top + 8, "", ha="right")
        self._curve(self.axes(566, top + 44, 314, 96))

    def axes(self, x_px: float, y_px: float, width_px: float, height_px: float) -> Axes:
        """Axes in a box of whole pixels, given from the upper left corner of the picture."""
        low = 1 - (y_px + height_px) / HEIGHT_PX
        return self.figure.add_axes(
            (x_px / WIDTH_PX, low, width_px / WIDTH_PX, height_px / HEIGHT_PX)
        )

    def text(self, x_px: float, y_px: float, words: str, **style: Any) -> Text:
        """Write words below and right of a pixel."""
        defaults: Any = {"va": "top", "ha": "left", "color": INK, "size": SIZE}
        return self.figure.text(x_px / WIDTH_PX, 1 - y_px / HEIGHT_PX, words, **defaults | style)

    def _map(self, axis: Axes) -> None:
        """Draw the site and the training path; empty lines for dots, robot and answer."""
        drive = self.drive
        empty = np.empty((2, 0))
        paths = np.concatenate([drive.train_xy_m, drive.xy_m])
        low = paths.min(axis=0)
        high = paths.max(axis=0)
        margin_m = 0.07 * float((high - low).max()) + 1.0
        low = low - margin_m
        high = high + margin_m
        axis.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", anchor="NW")
        axis.set_axis_off()
        axis.plot(*drive.walls_xy_m.T, ls="", marker="s", ms=1.6, mew=0, color=WALL, zorder=1)
        axis.plot(*drive.train_xy_m.T, color=PATH, lw=1.2, zorder=2)
        scale_bar(axis, np.stack([low, high]), SIZE - 1)
        self.dots = {
            code: axis.plot(
                *empty, ls="", marker=marker, ms=size, color=TINTS[code], mew=0, zorder=3 + order
            )[0]
            for order, (code, (marker, size)) in enumerate(MARKS.items())
        }
        self.miss = axis.plot(*empty, color=TINTS[WRONG], lw=1.4, zorder=6)[0]
        self.answer = axis.plot(*empty, "o", ms=14, mfc="none", mew=2, zorder=7)[0]
        self.robot = axis.plot(*empty, "o", ms=9, color=INK, mew=0, zorder=8)[0]
        self.ahead = axis.plot(*empty, color=INK, lw=2.6, zorder=8)[0]
        self.ahead_m = 0.8 * margin_m
        self._legend(
            f"answer within {drive.correct_m:g} m",
            f"training over {drive.seen_m:g} m away: not counted",
        )

    def _legend(self, right: str, not_counted: str) -> None:
        """Draw the legend of the dots and the line, below the map."""
        words = {RIGHT: right, WRONG: "answer farther off", NOT_COUNTED: not_counted}
        entries = [dot(word, TINTS[code], MARKS[code][0]) for code, word in words.items()]
        for entry in entries:
            entry.set_markersize(8)
        entries.insert(2, Line2D([], [], color=PATH, lw=1.6, label="training path"))
        corner: Any = {"loc": "lower left", "bbox_to_anchor": (0.01, 0.0)}
        self.figure.legend(handles=entries, ncols=2, fontsize=SIZE, columnspacing=1.4, **corner)

    def _view(self, y_px: float) -> Any:
        """An empty image of three pixels a bin of the usual Scan Context."""
        axis = self.axes(520, y_px, 360, 120)
        axis.set_axis_off()
        return axis.imshow(np.zeros((1, 1, 3), np.uint8), aspect="auto", interpolation="nearest")

    def _curve(self, axis: Axes) -> None:
        """Draw axes of the share of right answers over metres driven, and an empty line."""
        axis.set(
            xlim=(0, max(float(self.drive.driven_m[-1]), 1.0)), ylim=(0, 1.03), yticks=[0, 0.5, 1]
        )
        axis.set_yticklabels(["0", "50", "100 %"])
        axis.tick_params(labelsize=SIZE - 1)
        axis.grid(axis="y")
        axis.set_xlabel("metres driven", size=SIZE, labelpad=3)
        self.curve = axis.plot([], [], color=TINTS[RIGHT], lw=2.4)[0]
        self.end = axis.plot([], [], "o", ms=7, color=TINTS[RIGHT], mew=0, clip_on=False)[0]

    @styled
    def drawn(self, query: int, pair: NDArray[np.float32] | None) -> NDArray[np.uint8]:
        """Draw the frame (height, width, 3) at a query.

        `pair` are the heights (2, ring, sector) of its view and of the matched training view.
        """
        outcome = int(self.drive.outcome[query])
        upto = slice(query + 1)
        drive = self.drive
        for code, dots in self.dots.items():
            dots.set_data(*drive.xy_m[upto][drive.outcome[upto] == code].T)
        here = drive.xy_m[query]
        answer = drive.answer_xy_m[query]
        angle = drive.heading_rad[query]
        self.robot.set_data(*here[:, None])
        self.ahead.set_data(
            *np.stack([here, here + self.ahead_m * np.array([np.cos(angle), np.sin(angle)])]).T
        )
        self.answer.set_data(*(np.full(2, np.nan) if outcome == NOT_COUNTED else answer)[:, None])
        self.answer.set_markeredgecolor(TINTS[outcome])
        self.miss.set_data(*np.stack([here, answer if outcome == WRONG else here]).T)
        if outcome == NOT_COUNTED:
            self.off.set(text="not counted", color=GREY)
        else:
            words = (
                f"{drive.error_m[query]:.0f} m off" if np.isfinite(answer).all() else "no answer"
            )
            self.off.set(text=words, color=TINTS[outcome])
        counted, right = drive.counted[:, upto]
        share = np.divide(right, counted, out=np.full(len(right), np.nan), where=counted > 0)
        self.curve.set_data(drive.driven_m[upto], share)
        self.end.set_data(drive.driven_m[upto][-1:], share[-1:])
        self.number.set_text(f"{share[-1]:.1%}".replace("%", " %") if counted[-1] else "")
        self.counts.set_text(f"{right[-1]} of {counted[-1]} answers are right")
        for image, heights_m in zip(self.images, () if pair is None else pair, strict=True):
            image.set_data(
                HEIGHTS[quantize(np.nan_to_num(heights_m)).astype(int) * (len(HEIGHTS) - 1) // 255]
            )
        self.agg.draw()
        return np.array(self.agg.buffer_rgba())[..., :3]
