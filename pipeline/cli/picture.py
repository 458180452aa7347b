"""`yearloc picture`: a moving picture of one test day."""

import argparse
from pathlib import Path
from typing import Any

from pipeline.cli.localize import check_folder
from pipeline.cli.progress import Bar
from pipeline.cli.project import read_studies
from pipeline.errors import ConfigError


def add_command(commands: Any) -> None:
    """Add the command to the parser."""
    draw = commands.add_parser("picture", help="a moving picture of one test day: the drive, and which answers are right")
    draw.add_argument("of", metavar="STUDY/GRID/METHOD", help="such as campus/10m/sci_ring; a variant is METHOD-VARIANT")
    draw.add_argument("day", nargs="?", metavar="DAY", help="a test day (the last)")
    draw.add_argument("-o", "--out", type=Path, required=True, metavar="FILE", help="its name ends in .gif, .webp or .png")


def picture(given: argparse.Namespace) -> None:
    """Draw it, and say how large it is."""
    from pipeline.evaluation import results
    from pipeline.report.figures import animation
    from pipeline.report.figures import picture as moving
    from pipeline.report.figures.drive import Drive
    from pipeline.report.study import Study
    from pipeline.studies.expansion import answerers, asks_about_the_year

    check_folder(given.out)
    animation.check_ending(given.out)
    studies, (name, grid, model) = read_studies(), _parts(given.of)
    if name not in studies or grid not in studies[name]["grids"]:
        known = ", ".join(f"{one}/{own}" for one, study in studies.items() for own in study["grids"])
        raise ConfigError(f"{given.of}: no such study and grid, expected one of {known or 'none: `yearloc use campus` first'}")
    study = studies[name]
    if not asks_about_the_year(study):
        raise ConfigError(f"{given.of}: this study turns robots where they stand, and drives no test day")
    if model not in (models := [one.name for one in answerers(study)]):
        raise ConfigError(f"{given.of}: no such method, expected one of {', '.join(models)}")
    days = [*study["tests"], *study.get("stress", {})]
    artifacts = Path("artifacts")
    if given.day and given.day not in days:
        raise ConfigError(f"{given.day}: no such test day, expected one of {', '.join(days)}")
    table = results.read(artifacts, [name])
    age = dict(zip(table["sequence"], table["days"], strict=True))
    sequence = given.day or max(study["tests"], key=lambda test: age.get(test, 0))
    drive = Drive.of(Study(artifacts, name, study, grid, table), model, sequence)
    frames, size = moving.write(drive, given.out, Bar())
    counted, right = drive.counted[:, -1]
    share = f"{right} of {counted} answers right within {drive.correct_m:g} m{', simulated' * drive.simulated}"
    print(f"{given.out}: {drive.title}: {share}; {frames} frames, {size / 1e6:.2f} MB")


def _parts(name: str) -> tuple[str, str, str]:
    """Study, grid and model."""
    try:
        study, grid, model = name.split("/")
    except ValueError:
        raise ConfigError(f"{name}: expected STUDY/GRID/METHOD, such as campus/10m/sci_ring") from None
    return study, grid, model
