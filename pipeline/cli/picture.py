"""`yearloc picture` draws a moving picture of a drive, which shows the answers that are accepted.

The drive is a test day of a study, over the map of the training day, or a log in the plan of a
level site (a building that a 2-D laser knows).
"""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.options import Odometry, Strict, TargetPrecision, Topic
from pipeline.cli.outputs import check_file
from pipeline.cli.progress import Bar
from pipeline.cli.project import named_model
from pipeline.cli.scan_options import scan_options, told_kept
from pipeline.core.errors import ConfigError, LogError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    import pandas as pd

    from pipeline.studies.study import Study


def picture(
    of: Annotated[
        str,
        typer.Argument(
            metavar="STUDY/GRID/METHOD|SITE",
            help="A model of a study, such as campus/10m/sci_ring, or a level site",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "-o", "--out", metavar="FILE", help="The picture, a .gif, a .webp or an animated .png"
        ),
    ],
    day: Annotated[
        str | None,
        typer.Argument(
            metavar="DAY|LOG",
            help="With a study: a test day, by default the last. With a site: a log or a bag",
        ),
    ] = None,
    target_precision: TargetPrecision = 0.99,
    strict: Strict = False,
    topic: Topic = None,
    odometry: Odometry = None,
) -> None:
    """Draw a moving picture of one test day: the drive, and which answers are accepted.

    With a level site, it shows a tracked log or bag in the plan of the building.
    """
    if of.endswith(".site"):
        print(draw_level_drive(Path(of), day, out, target_precision, strict, topic, odometry))
    else:
        summary_line, _ = draw(of, day, out)
        print(summary_line)


def draw(of: str, test_day: str | None, out: Path) -> tuple[str, str]:
    """Write the moving picture of STUDY/GRID/METHOD on a test day, by default the last.

    Returns a line on what it shows, and the picture with its caption for README.md.
    """
    from pipeline.evaluation import results
    from pipeline.report.figures import animation, chase
    from pipeline.report.figures.accepted import AcceptedDrive
    from pipeline.report.study import StudyResults as StudyOfGrid
    from pipeline.studies.layout import Layout

    check_file(out)
    animation.check_ending(out)
    study, grid, model = named_model(of)
    _check_model_and_day(study, model, test_day, of)
    table = results.read(Layout(), {study.name: study})
    sequence = test_day or last_day(table, study.tests)
    drive = AcceptedDrive.of(StudyOfGrid(Layout(), study, grid, table), model, sequence)
    frame_count, _ = chase.write(drive, out, Bar())
    accepted, accepted_wrong, refused, refused_wrong = drive.counts[:, -1].tolist()
    noun = "pose" if drive.posed else "answer"
    shown = (
        f"{drive.title}: {accepted} {noun}s accepted, {accepted_wrong} wrong among them; "
        f"{refused} refused, {refused_wrong} wrong among them"
    )
    size_mb = out.stat().st_size / 1e6
    simulated = ", simulated" if drive.simulated else ""
    return (
        f"{out}: {shown}{simulated}; {frame_count} frames, {size_mb:.2f} MB",
        f"![{shown}]({out.as_posix()})\n\n*{'Simulated' if simulated else 'Recorded'}. {shown}. "
        f"The map is grey; a scan is blue where its {noun} is accepted, orange where refused.*",
    )


def draw_level_drive(
    path: Path,
    log: str | None,
    out: Path,
    target_precision: float | None,
    strict: bool,
    topic: str | None,
    odometry: str | None,
) -> str:
    """Write the moving picture of a drive through a level site; returns a line on what it shows.

    Raises ConfigError for a site of 3-D scans, or without a log.
    """
    from pipeline.online.level_site import LevelSite
    from pipeline.online.localized import localized
    from pipeline.online.site import Site
    from pipeline.online.tracking import Tracker
    from pipeline.report.figures import animation, level_plan

    check_file(out)
    animation.check_ending(out)
    site = Site.open(path)
    if not isinstance(site, LevelSite):
        raise ConfigError(f"{path}: a site of 3-D scans; `yearloc watch` shows its drives")
    if log is None:
        raise ConfigError(f"{path}: expected a log or a bag after it")
    target_precision = told_kept(site, target_precision, strict)
    skipped: Counter[str] = Counter()
    broken: list[str] = []  # for each sweep that could not be read, why
    sweeps = scan_options(site, topic=topic, odometry=odometry).scans(log, skipped)
    drive = [
        level_plan.Seen(points_m, fix, scan.world_T_scan)
        for scan, points_m, fix in localized(
            sweeps, Tracker(site, target_precision), target_precision, broken
        )
    ]
    if not drive:
        raise LogError(broken[0] if broken else f"{log}: no scan there")
    title = f"{site.title}: {Path(log).name}"
    frame_count, size_bytes = level_plan.write(site.level_map, drive, title, out, Bar())
    n_accepted = sum(seen.fix.verdict == "accepted" for seen in drive)
    return (
        f"{out}: {title}: {n_accepted} of {len(drive)} sweeps accepted; {frame_count} frames, "
        f"{size_bytes / 1e6:.2f} MB"
    )


def last_day(table: "pd.DataFrame", tests: Sequence[str]) -> str:
    """The test day that is furthest from the training day.

    `table` is the table of results; its column `days` is empty in rows that belong to no day.
    """
    rows_with_day = table[table["days"].notna()].drop_duplicates("sequence")
    days_after: dict[str, float] = rows_with_day.set_index("sequence")["days"].to_dict()
    return max(tests, key=lambda test: days_after.get(test, 0.0))


def _check_model_and_day(study: "Study", model: str, test_day: str | None, of: str) -> None:
    """Raise ConfigError for a study without test days, or a model or day that it lacks."""
    if not study.tests_over_days:
        raise ConfigError(f"{of}: the experiment of this study has no test day to draw")
    models = [answers.name for answers in study.answerers]
    if model not in models:
        raise ConfigError(f"{of}: no such method, expected one of {', '.join(models)}")
    if test_day and test_day not in study.query_days:
        raise ConfigError(
            f"{test_day}: no such test day, expected one of {', '.join(study.query_days)}"
        )
