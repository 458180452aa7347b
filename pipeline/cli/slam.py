"""`yearloc slam` estimates the poses of a log from its scans alone.

It writes them as a trajectory, and optionally a map of all points and a picture of the trajectory.
"""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.options import Topic
from pipeline.cli.outputs import check_file, check_folder
from pipeline.cli.progress import Scans
from pipeline.core.errors import ConfigError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from pipeline.core.schemas import Estimates


def slam(
    log: Annotated[
        Path,
        typer.Argument(
            metavar="LOG",
            help="A bag, the folder of a log, or a folder of clouds (.bin .npy .pcd)",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--out",
            metavar="FILE",
            help="Write the poses to this file as a TUM trajectory: stamp x y z qx qy qz qw",
        ),
    ] = None,
    map_path: Annotated[
        str | None,
        typer.Option(
            "--map",
            metavar="OUT",
            help="Write the points of all scans: FILE.pcd, FILE.ply, or FOLDER/ of Autoware's "
            "tiles; `yearloc pack --map OUT` makes a site of it",
        ),
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Draw the trajectory from above into this .png file"),
    ] = None,
    topic: Topic = None,
    odometry: Annotated[
        str | None,
        typer.Option(
            metavar="TOPIC",
            help="Odometry of a bag, a topic of poses or tf:PARENT>CHILD; none ignores the "
            "odometry that the log has",
        ),
    ] = None,
) -> None:
    """Estimate the poses of a log: odometry by registration, loop closures, a pose graph."""
    from pipeline.core.replacing import replace, write_text
    from pipeline.mapping.map_output import MapOutput
    from pipeline.opening.opening import unposed
    from pipeline.slam import outputs
    from pipeline.slam.drive import Slam, without_ground_truth

    if not (out or map_path or picture):
        raise ConfigError("nothing to write: expected -o FILE, --map OUT or --picture FILE")
    if picture and picture.suffix != ".png":
        raise ConfigError(f"{picture}: expected a file that ends in .png")
    map_output = MapOutput.of(map_path) if map_path else None
    for path in (out, picture):
        check_file(path)
    if map_output:
        (check_folder if map_output.is_folder else check_file)(map_output.path)
    uses_odometry = odometry != "none"
    odometry_topic = odometry if uses_odometry else None
    opened_log = without_ground_truth(unposed(log, topic, odometry_topic))
    tell_cold()
    progress = Scans()
    estimate = Slam(use_log_odometry=uses_odometry).estimate(opened_log, progress)
    if out:
        write_text(out, outputs.tum_text(estimate))
    if map_output:
        map_output.write(outputs.slam_map(opened_log, estimate, progress))
    if picture:
        with replace(picture) as scratch:
            outputs.draw(estimate, scratch, log.name)
    paths = (out, map_output and map_output.path, picture)
    _tell(estimate, opened_log.notes, [path for path in paths if path])


def _tell(estimate: "Estimates", notes: tuple[str, ...], paths: list[Path]) -> None:
    """Print a summary of the estimate on standard error, and the `paths` that were written."""
    from pipeline.slam import summary

    for line in (*notes, *summary.lines(estimate)):
        print(f"  {line}", file=sys.stderr)
    print(f"written: {', '.join(map(str, paths))}", file=sys.stderr)
