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
    """Parse the value of `--target-precision`: a share, or None for the word none."""
    try:
        return None if word == "none" else float(word)
    except ValueError:
        raise ValueError("expected a share or the word none") from None


def some_words(metavar: str, help_text: str) -> Any:
    """A command-line argument that takes any number of words, by default none."""
    return typer.Argument(metavar=metavar, default_factory=list, show_default=False, help=help_text)


SitePath = Annotated[Path, typer.Argument(metavar="SITE")]
TargetPrecision = Annotated[
    float | None,
    typer.Option(
        metavar="P",
        parser=share_or_none,
        help="accept only poses that are right with at least this probability, as calibrated on "
        "validation blocks; none accepts no pose",
    ),
]
BodyTLidar = Annotated[
    str | None,
    typer.Option(
        "--body-T-lidar",
        metavar="X,Y,Z,ROLL,PITCH,YAW",
        help="turns and raises the points, by metres and degrees; in place of a bag's transforms, "
        "but not of logs",
    ),
]
Topic = Annotated[
    str | None, typer.Option(metavar="TOPIC", help="of a bag, where it has several clouds")
]
Odometry = Annotated[
    str | None,
    typer.Option(
        metavar="TOPIC", help="of a bag, for --track or a level site: poses, or tf:PARENT>CHILD"
    ),
]
Track = Annotated[
    bool,
    typer.Option(
        "--track", help="scans are one path: follow it, by odometry where the log has some"
    ),
]
Follow = Annotated[
    bool,
    typer.Option(
        "--follow",
        help="the input is an .mcap still being recorded; what waits too long is dropped",
    ),
]
Idle = Annotated[
    float, typer.Option(metavar="S", help="of --follow: ends after so long without a byte")
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
