"""The moving picture of a drive with a level laser: the plan of a building, and the robot in it.

Walls are dark, and known free space is white. Each sweep is drawn at its fix (a pose and a verdict
on it), in the colour of the verdict. A ring shows where the robot was according to the log, and
accepted poses leave a dot.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from pipeline.core.frames import transformed
from pipeline.core.progress import Progress
from pipeline.level.level_map import LevelMap
from pipeline.mapping.from_above import ROBOT
from pipeline.online.site import Fix
from pipeline.online.watch import COLOURS
from pipeline.report.figures import animation
from pipeline.report.figures.animation import font
from pipeline.report.figures.chase import GREY, INK

WIDTH_PX = 800
MOST_HEIGHT_PX = 700
HEAD_PX = 56  # height of the lines of text above the plan
MOST_FRAMES = 120
MARGIN_M = 1.0  # around what is known of the building
UNKNOWN = "#E4E4E4"
FREE = "#FFFFFF"
WALL = "#4A4A4A"
WALL_SHARE = 0.15  # a pixel with at least this fraction of wall is drawn as a wall
ROBOT_M = 1.0  # least length of the robot's arrow, so that it can be seen
ROBOT_PX = 15.0


class Seen(NamedTuple):
    """A sweep and its fix."""

    points_m: NDArray[np.float64]  # (n, 2) or (n, 3) hits, in the robot's frame
    fix: Fix
    world_T_true: NDArray[np.float64]  # (4, 4); NaN where it is not known


class Plan:
    """A level map as an image, as large as there is room for, and where the world lies in it."""

    def __init__(self, level_map: LevelMap) -> None:
        """Draw the known part of a map, turned by 90° if it is higher than wide."""
        walls = level_map.walls
        free = level_map.free
        self._plan_T_world = np.asarray(np.linalg.inv(level_map.world_T_grid), np.float64)
        known = np.argwhere(walls | free)
        if np.ptp(known[:, 0]) > np.ptp(known[:, 1]):
            # a quarter turn to the right: x of the plan is y of the map, its y runs against x
            plan_T_grid = np.array([[0.0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
            plan_T_grid[1, 3] = walls.shape[1] * level_map.cell_m
            self._plan_T_world = plan_T_grid @ self._plan_T_world
            walls = walls.T[::-1]
            free = free.T[::-1]
            known = np.argwhere(walls | free)
        # the cells to draw, and the size of the picture that has room for them
        margin = round(MARGIN_M / level_map.cell_m)
        low = np.maximum(known.min(axis=0) - margin, 0)
        high = np.minimum(known.max(axis=0) + 1 + margin, walls.shape)
        rows, cols = (slice(*ends) for ends in zip(low.tolist(), high.tolist(), strict=True))
        height, width = (high - low).tolist()
        scale = min(WIDTH_PX / width, (MOST_HEIGHT_PX - HEAD_PX) / height)
        size = (max(1, round(width * scale)), max(1, round(height * scale)))
        # the picture; a wall is thinner than a pixel, so a small fraction of it counts
        unknown, known_free, wall = animation.rgb((UNKNOWN, FREE, WALL))
        pixels = np.full((size[1], size[0], 3), unknown)
        pixels[_shares(free[rows, cols], size) > 0.5] = known_free
        pixels[_shares(walls[rows, cols], size) > WALL_SHARE] = wall
        self._scale = scale / level_map.cell_m
        self._corner_m = low[::-1] * level_map.cell_m
        self.image = Image.new("RGB", (WIDTH_PX, HEAD_PX + size[1]), FREE)
        self.image.paste(Image.fromarray(pixels), (0, HEAD_PX))

    def at_px(self, points_m: NDArray[np.float64]) -> NDArray[np.float64]:
        """The pixels (n, 2) of points (n, 2) in the world."""
        plan_m = transformed(self._plan_T_world, points_m)
        at_px = (plan_m - self._corner_m) * self._scale
        at_px[:, 1] = self.image.height - at_px[:, 1]
        return np.asarray(at_px)

    def robot_px(self, world_T_robot: NDArray[np.float64]) -> tuple[float, float]:
        """The pixel of a robot (4, 4)."""
        x, y = self.at_px(world_T_robot[None, :2, 3])[0].tolist()
        return x, y

    def px(self, length_m: float) -> float:
        """A length in pixels."""
        return float(length_m * self._scale)


def write(
    level_map: LevelMap, drive: Sequence[Seen], title: str, path: Path, progress: Progress
) -> tuple[int, int]:
    """Write the picture as .gif, .webp or (animated) .png; returns its frames and bytes.

    The same drive gives the same bytes. Raises ConfigError for another ending.
    """
    plan = Plan(level_map)
    inks = (INK, GREY, WALL, UNKNOWN, *("rgb({}, {}, {})".format(*c) for c in COLOURS.values()))
    return animation.write(
        path,
        len(drive),
        MOST_FRAMES,
        lambda number: frame(plan, drive[: number + 1], title),
        inks,
        (FREE,),
        progress,
    )


def frame(plan: Plan, drive: Sequence[Seen], title: str) -> NDArray[np.uint8]:
    """Draw the frame (height, width, 3) at the last of the sweeps so far."""
    image = plan.image.copy()
    draw = ImageDraw.Draw(image)
    for seen in drive:
        if seen.fix.verdict == "accepted":
            draw.circle(plan.robot_px(seen.fix.world_T_sensor), 1.5, fill=COLOURS["accepted"])
    points_m, fix, world_T_true = drive[-1]
    colour = COLOURS[fix.verdict]
    if np.isfinite(fix.world_T_sensor).all():
        world_T_robot = fix.world_T_sensor
        hits_m = transformed(world_T_robot, points_m[:, :2])
        for x, y in plan.at_px(hits_m).tolist():
            draw.rectangle((x - 1, y - 1, x + 1, y + 1), fill=colour)
        if fix.verdict == "ambiguous":
            for runner_up in fix.runners_up:
                _arrow(draw, plan, runner_up.world_T_sensor, None)
        _arrow(draw, plan, world_T_robot, colour)
    if np.isfinite(world_T_true).all():
        radius_px = max(7.0, plan.px(0.8))
        draw.circle(plan.robot_px(world_T_true), radius_px, outline=INK, width=2)
    draw.text((12, 7), title, INK, font(16, bold=True))
    counts = {word: sum(seen.fix.verdict == word for seen in drive) for word in COLOURS}
    counted = ", ".join(f"{count} {word}" for word, count in counts.items() if count)
    draw.text((12, 31), f"sweep {len(drive)}: {counted}", GREY, font(13))
    draw.text((WIDTH_PX - 12, 7), fix.verdict, colour, font(18, bold=True), anchor="ra")
    probability = f"probability of the pose {1 - fix.novelty:.2f}"
    draw.text((WIDTH_PX - 12, 31), probability, GREY, font(13), anchor="ra")
    return np.asarray(image)


def _arrow(
    draw: ImageDraw.ImageDraw,
    plan: Plan,
    world_T_robot: NDArray[np.float64],
    colour: tuple[int, int, int] | None,
) -> None:
    """Draw the robot as an arrow, which is hollow without a colour."""
    length_m = max(ROBOT_M, ROBOT_PX / plan.px(1.0))
    corners_m = length_m / np.ptp(ROBOT[:, 0]) * ROBOT
    in_world_m = transformed(world_T_robot, corners_m)[:, :2]
    corners_px = [tuple(corner) for corner in plan.at_px(in_world_m).tolist()]
    draw.polygon(corners_px, fill=colour, outline=INK)


def _shares(cells: NDArray[np.bool_], size: tuple[int, int]) -> NDArray[np.float64]:
    """How much of each pixel (height, width), 0 to 1, is True in the cells (row 0 lies below)."""
    image = Image.fromarray(255 * cells[::-1].astype(np.uint8))
    return np.asarray(image.resize(size, Image.Resampling.BOX)) / 255
