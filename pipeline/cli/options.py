"""Arguments and options that several commands share, as annotated types for their signatures.

typer reads names, help and parsers off these annotations. Below them are the functions that check
or convert the values.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from pipeline.core.frames import Poses


def share_or_none(word: str) -> float | None:
    """Parse the value of `--target-precision`: a share, or the word none, which becomes None."""
    try:
        return None if word == "none" else float(word)
    except ValueError:
        raise ValueError("expected a share or the word none") from None


def some_words(metavar: str, help_text: str) -> Any:
    """A command-line argument that takes any number of words, by default none."""
    return typer.Argument(metavar=metavar, default_factory=list, show_default=False, help=help_text)


SitePath = Annotated[
    Path, typer.Argument(metavar="SITE", help="A site file, as `yearloc pack` writes it")
]
TargetPrecision = Annotated[
    float | None,
    typer.Option(
        metavar="P",
        parser=share_or_none,
        help="Accept only poses that are right with at least this probability, as calibrated on "
        "validation blocks; none accepts no pose. Without a threshold for it, a line says so, and "
        "the next higher one is used, or else the highest",
    ),
]
Strict = Annotated[
    bool,
    typer.Option(
        "--strict", help="Refuse a target precision that cannot be kept, instead of a lower one"
    ),
]
BodyTLidar = Annotated[
    str | None,
    typer.Option(
        "--body-T-lidar",
        metavar="X,Y,Z,ROLL,PITCH,YAW",
        help="Pose of the lidar in the robot's frame, in metres and degrees, instead of a bag's "
        "transforms; without effect on logs, which their reader places",
    ),
]
Topic = Annotated[
    str | None,
    typer.Option(metavar="TOPIC", help="Topic of the clouds, for a bag with several"),
]
Odometry = Annotated[
    str | None,
    typer.Option(
        metavar="TOPIC",
        help="Odometry of a bag, a topic of poses or tf:PARENT>CHILD; used with --track or a "
        "level site",
    ),
]
Track = Annotated[
    bool,
    typer.Option(
        "--track",
        help="Track the robot: combine the fixes of all scans so far, with the log's odometry if "
        "it has any",
    ),
]
Follow = Annotated[
    bool,
    typer.Option(
        "--follow",
        help="Read an .mcap that is still being recorded; scans that come too fast are dropped",
    ),
]
Idle = Annotated[
    float,
    typer.Option(metavar="S", help="With --follow: end after S seconds without new data"),
]


PriorText = Annotated[
    str | None,
    typer.Option(
        "--prior",
        metavar="X,Y[,HEADING]",
        help="Where the robot is believed to be, in metres and degrees: searched first; with "
        "--track, where the drive begins",
    ),
]
PriorSigma = Annotated[
    str | None,
    typer.Option(
        metavar="METRES[,DEGREES]", help="The standard deviations of --prior [5 m and 20°]"
    ),
]

Gnss = Annotated[
    str | None,
    typer.Option(
        "--gnss",
        metavar="TOPIC",
        help="NavSatFix of a bag: searched first, as with --prior; with --track while the robot is "
        "lost; the site needs a datum (yearloc pack --datum)",
    ),
]


def lidar_of(body_T_lidar: str | None) -> "Poses | None":
    """The pose (4, 4) of the lidar that `--body-T-lidar` gives; None without the option."""
    from pipeline.online.inputs import placement

    return None if body_T_lidar is None else placement("--body-T-lidar", body_T_lidar)


def only_one(options: Mapping[str, object]) -> str | None:
    """The name of the one option with a value, or None; raises typer.BadParameter for two.

    `options` has the values by name, None or False of an option that is not given.
    """
    names = [name for name, value in options.items() if value is not None and value is not False]
    if len(names) > 1:
        first, second, *_ = names
        raise typer.BadParameter(f"not together with --{first}", param_hint=f"--{second}")
    return next(iter(names), None)
