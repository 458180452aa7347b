"""The moving picture of one test day in 3-D: the robot seen from behind, driving through its map.

The map is grey. Each scan is drawn where it was registered, in the colour of its verdict. A dot
stays where the robot was, and a count of accepted, wrong and refused poses is shown.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from pipeline.core.frames import Poses, transformed, yaw
from pipeline.core.progress import Progress
from pipeline.mapping.from_above import ROBOT
from pipeline.report.figures import animation
from pipeline.report.figures.accepted import AcceptedDrive
from pipeline.report.figures.animation import font
from pipeline.report.figures.style import SIMULATED

WIDTH_PX = 800
HEIGHT_PX = 450
MOST_FRAMES = 90
# Where the camera is: its distance behind the robot and above it, and that of the point ahead of
# the robot that it looks at.
BEHIND_M = 26.0
ABOVE_M = 17.0
AHEAD_M = 14.0
FOCAL_PX = 520.0
# Points nearer to the camera or farther off than these are not drawn.
NEAREST_M = 4.0
FARTHEST_M = 90.0
WIDE_M = 45.0  # map points nearer than this are two pixels wide, as all points of a scan are
ACCEPTED = "#1878C7"
REFUSED = "#D55E00"
WRONG = "#000000"
INK = "#222222"
GREY = "#6E6E6E"
# The inks of map points, from near to far.
GREYS = ("#7A7A7A", "#8E8E8E", "#A3A3A3", "#B8B8B8", "#CCCCCC", "#DDDDDD")
VERDICTS = {True: ("accepted", ACCEPTED), False: ("refused", REFUSED)}
PLAN_PX = (170, 150)  # the plan of the whole drive, in the lower right corner
TEXT_PX = 15


def write(drive: AcceptedDrive, path: Path, progress: Progress) -> tuple[int, int]:
    """Write the picture as .gif, .webp or (animated) .png; returns its frames and bytes.

    The same artifacts give the same bytes. Raises ConfigError for another ending.
    """
    counts = drive.counts
    return animation.write(
        path,
        len(drive.accepted),
        MOST_FRAMES,
        lambda query: frame(drive, query, counts[:, query].tolist()),
        (ACCEPTED, REFUSED, WRONG, INK, GREY),
        GREYS,
        progress,
    )


def frame(drive: AcceptedDrive, query: int, counts: Sequence[int]) -> NDArray[np.uint8]:
    """Draw the frame (height, width, 3) at a query, with the counts up to it."""
    camera_T_world = chase(drive.world_T_true[query])
    pixels = np.full((HEIGHT_PX, WIDTH_PX, 3), 255, np.uint8)
    splat(pixels, camera_T_world, drive.map_m, GREYS)
    _, ink = VERDICTS[bool(drive.accepted[query])]
    splat(pixels, camera_T_world, drive.placed_points_m(query), (ink,), are_all_wide=True)
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    _dots(draw, drive, query, camera_T_world)
    _robot(draw, drive.world_T_true[query], camera_T_world)
    _plan(draw, drive, query)
    _words(draw, drive, query, counts)
    return np.asarray(image)


def chase(world_T_robot: Poses) -> Poses:
    """camera_T_world (4, 4) of a camera behind a robot (4, 4).

    x of the camera is to the right, y down, and z ahead.
    """
    turn_rad = float(yaw(world_T_robot))
    ahead = np.array([np.cos(turn_rad), np.sin(turn_rad), 0.0])
    robot_m = world_T_robot[:3, 3]
    eye_m = robot_m - BEHIND_M * ahead + (0.0, 0.0, ABOVE_M)
    viewing = robot_m + AHEAD_M * ahead - eye_m  # the direction of view
    viewing /= np.linalg.norm(viewing)
    to_right = np.array([ahead[1], -ahead[0], 0.0])
    camera_T_world = np.eye(4)
    camera_T_world[:3, :3] = [to_right, np.cross(viewing, to_right), viewing]
    camera_T_world[:3, 3] = -camera_T_world[:3, :3] @ eye_m
    return camera_T_world


def projected(
    camera_T_world: Poses, points_m: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The pixels (n, 2) and depths (n,) in metres of points (n, 3) before the camera.

    Points outside the picture, too near or too far are left out.
    """
    seen_m = transformed(camera_T_world, points_m)
    seen_m = seen_m[(seen_m[:, 2] > NEAREST_M) & (seen_m[:, 2] < FARTHEST_M)]
    depth_m = seen_m[:, 2]
    at_px = seen_m[:, :2] * (FOCAL_PX / depth_m)[:, None] + (WIDTH_PX / 2, HEIGHT_PX / 2)
    shown = ((at_px >= 0) & (at_px < (WIDTH_PX - 1, HEIGHT_PX - 1))).all(axis=1)
    return at_px[shown], depth_m[shown]


def splat(
    pixels: NDArray[np.uint8],
    camera_T_world: Poses,
    points_m: NDArray[np.float64],
    inks: Sequence[str],
    are_all_wide: bool = False,
) -> None:
    """Draw points (n, 3) of the world, far ones first, in inks from near to far.

    Near points are two pixels wide, or all if `are_all_wide`.
    """
    at_px, depth_m = projected(camera_T_world, points_m)
    order = np.argsort(-depth_m, kind="stable")
    columns, rows = at_px[order].astype(np.int64).T
    shade = (depth_m[order] / FARTHEST_M * len(inks)).astype(np.int64)
    colours = animation.rgb(inks)[shade]
    pixels[rows, columns] = colours
    is_wide = np.full(len(shade), True) if are_all_wide else depth_m[order] < WIDE_M
    for down, right in ((0, 1), (1, 0), (1, 1)):
        pixels[rows[is_wide] + down, columns[is_wide] + right] = colours[is_wide]


def _dots(
    draw: ImageDraw.ImageDraw, drive: AcceptedDrive, query: int, camera_T_world: Poses
) -> None:
    """Draw dots where the robot was, in the colours of verdicts, larger ones for refused poses."""
    ground_m = drive.world_T_true[: query + 1, :3, 3]
    for accepted, ink, radius_m in ((True, ACCEPTED, 0.35), (False, REFUSED, 0.8)):
        chosen = ground_m[drive.accepted[: query + 1] == accepted]
        at_px, depth_m = projected(camera_T_world, chosen)
        radii_px = radius_m * FOCAL_PX / depth_m
        for (x, y), radius_px in zip(at_px.tolist(), radii_px.tolist(), strict=True):
            flat_px = radius_px * 0.5  # the ground is seen from a low angle
            draw.ellipse((x - radius_px, y - flat_px, x + radius_px, y + flat_px), fill=ink)


def _robot(draw: ImageDraw.ImageDraw, world_T_robot: Poses, camera_T_world: Poses) -> None:
    """Draw the robot as an arrow on the ground."""
    at_px, _ = projected(camera_T_world, transformed(world_T_robot, ROBOT))
    draw.polygon([tuple(corner) for corner in at_px.tolist()], fill=INK)


def _plan(draw: ImageDraw.ImageDraw, drive: AcceptedDrive, query: int) -> None:
    """Draw the plan of the whole drive: queries so far in the colours of verdicts, wrong ones ×."""
    xy_m = drive.world_T_true[:, :2, 3]
    scale = float((np.array(PLAN_PX) / np.maximum(np.ptp(xy_m, axis=0), 1.0)).min())
    at_px = (xy_m - xy_m.min(axis=0)) * scale
    at_px[:, 1] = np.ptp(xy_m[:, 1]) * scale - at_px[:, 1]  # y of the world runs upwards
    at_px += np.array((WIDTH_PX - 14, HEIGHT_PX - 14)) - at_px.max(axis=0)
    background = (*(at_px.min(axis=0) - 9).tolist(), *(at_px.max(axis=0) + 9).tolist())
    draw.rectangle(background, fill="#FFFFFF")
    draw.line([tuple(at) for at in at_px.tolist()], fill=GREYS[3], width=1)
    for accepted, ink, radius_px in ((True, ACCEPTED, 1), (False, REFUSED, 2)):
        for at in at_px[: query + 1][drive.accepted[: query + 1] == accepted].tolist():
            draw.circle(at, radius_px, fill=ink)
    wrong = drive.accepted & ~drive.right
    for x, y in at_px[: query + 1][wrong[: query + 1]].tolist():
        draw.line((x - 4, y - 4, x + 4, y + 4), fill=WRONG, width=2)
        draw.line((x - 4, y + 4, x + 4, y - 4), fill=WRONG, width=2)
    draw.circle(at_px[query].tolist(), 4, fill=INK)


def _words(
    draw: ImageDraw.ImageDraw, drive: AcceptedDrive, query: int, counts: Sequence[int]
) -> None:
    """Write the days, the target precision, the counts so far, and the verdict on this scan."""
    acceptance = "at its own threshold"
    if drive.posed:
        acceptance = (
            f"target precision {drive.target_precision:g}"
            if drive.target_precision
            else "no target precision can be reached"
        )
    verdict, verdict_ink = VERDICTS[bool(drive.accepted[query])]
    accepted, wrong, refused, wrong_refused = counts
    right = WIDTH_PX - 14
    low = HEIGHT_PX - 72
    data = SIMULATED if drive.simulated else "recorded"
    draw.rectangle((0, 0, WIDTH_PX, 50), fill="#FFFFFF")
    draw.rectangle((0, HEIGHT_PX - 78, 385, HEIGHT_PX), fill="#FFFFFF")
    for x, y, text, ink, size_px, is_bold in (
        (14, 8, drive.title, INK, TEXT_PX + 2, True),
        (14, 30, f"{drive.where}, {drive.model}, {acceptance}", GREY, TEXT_PX - 2, False),
        (right, 8, data, GREY, TEXT_PX, False),
        (right, 29, verdict, verdict_ink, TEXT_PX, True),
        (14, low, f"{accepted} accepted", ACCEPTED, TEXT_PX + 2, True),
        (14, low + 22, f"{wrong} wrong among them", WRONG, TEXT_PX + 2, True),
        (
            14,
            low + 44,
            f"{refused} refused, {wrong_refused} wrong among them",
            REFUSED,
            TEXT_PX + 2,
            True,
        ),
    ):
        anchor = "ra" if x == right else "la"
        draw.text((x, y), text, ink, font(size_px, is_bold), anchor=anchor)
