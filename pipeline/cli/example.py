"""`yearloc example` localises three scans by the site that comes with the package.

A site is one file with all that it takes to localise in a place. It answers a scan by a fix: a
pose, and a verdict that says whether to accept it.
"""

from typing import TYPE_CHECKING

from pipeline.cli.kernels import tell_cold

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from pipeline.core.frames import Poses
    from pipeline.online.example import ExampleScan
    from pipeline.online.site import Fix, VerdictName

MEANINGS: dict["VerdictName", str] = {
    "accepted": "right at the target precision of {target_precision:g}",
    "near": "the pose may be wrong, but is at most 15 m off at the target precision",
    "ambiguous": "this pose or a runner-up is right at the target precision",
    "rejected": "neither pose nor place is accepted; the scan may be from elsewhere",
    "no pose": "too few points, or nothing fits",
}
"""What each verdict on a fix means, in words."""
TARGET_PRECISION = 0.99
"""The target precision: the wanted share of right poses among the accepted ones."""


def example() -> None:
    """Localise three scans of later days by a small simulated site that comes with the package."""
    from pipeline.core.frames import step_lengths_m
    from pipeline.online.example import SITE, scans
    from pipeline.online.site import Site

    site = Site.open(SITE)
    # the way from each anchor of the map to the next, in the plane
    steps_m = step_lengths_m(site.targets.world_T_anchor[:, :2, 3])
    print(
        f"{SITE.name}, simulated: {steps_m.sum():.0f} m of a campus, learned on "
        f"{site.description.provenance.train}; {SITE.stat().st_size / 1e6:.1f} MB"
    )
    tell_cold()
    for scan in scans():
        fix = site.localize(scan.points_m(), TARGET_PRECISION)
        print("", *lines(scan, fix), sep="\n", flush=True)


def lines(scan: "ExampleScan", fix: "Fix") -> list[str]:
    """The lines that show a fix: a heading, then verdict, pose with its error, and runner-up."""
    from pipeline.core.frames import distance_and_turn

    rows = [
        (
            "verdict",
            f"{fix.verdict}: {MEANINGS[fix.verdict].format(target_precision=TARGET_PRECISION)}",
        )
    ]
    if fix.verdict != "no pose":
        off_m, off_deg = distance_and_turn(fix.world_T_sensor, scan.world_T_scan)
        probability = f"probability {1 - fix.novelty:.3f}, {off_m:.2f} m and {off_deg:.1f}° off"
        rows.append(("pose", f"{_pose_text(fix.world_T_sensor)}; {probability}"))
    if fix.runners_up:
        second, *_ = fix.runners_up
        rows.append(
            (
                "runner-up",
                f"{_pose_text(second.world_T_sensor)}; probability {second.probability:.3f}",
            )
        )
    heading = f"{scan.path.name}, {scan.day}: {scan.about}"
    return [heading, *(f"  {name:<10} {text}" for name, text in rows)]


def _pose_text(world_T_sensor: "Poses") -> str:
    """Position and heading of a pose (4, 4) in the world."""
    import numpy as np

    from pipeline.core.frames import yaw

    x_m, y_m = world_T_sensor[:2, 3]
    heading_deg = float(np.rad2deg(yaw(world_T_sensor)))
    return f"x {x_m:.2f} m, y {y_m:.2f} m, heading {heading_deg:.1f}°"
