"""`yearloc failures`: pictures of what the verdict got wrong."""

import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.localize import left_out_text
from pipeline.cli.options import BodyTLidar, Promise, lidar_of
from pipeline.cli.outputs import check_folder
from pipeline.cli.project import read_studies
from pipeline.core.errors import ConfigError, LogError

if TYPE_CHECKING:
    from pipeline.core.frames import Poses
    from pipeline.online.failures import JudgedFix
    from pipeline.online.site import Site
    from pipeline.posing.targets import Targets


def failures(
    of: Annotated[
        str,
        typer.Argument(
            metavar="SITE|STUDY/GRID/METHOD", help="a site, or a model of a study that has poses"
        ),
    ],
    log: Annotated[
        str | None,
        typer.Argument(
            metavar="LOG|DAY",
            help="of a site a log with true poses; of a study one test day (all)",
        ),
    ] = None,
    body_T_lidar: BodyTLidar = None,
    worst: Annotated[int, typer.Option(metavar="N", help="so many at most")] = 20,
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="FOLDER", help="where the pictures go")
    ] = Path("failures"),
    promise: Promise = 0.99,
) -> None:
    """A picture of each fix that the verdict got wrong."""
    from pipeline.online import failures as cards

    check_folder(out)
    if of.count("/") == 2 and not Path(of).exists():
        targets, judged, simulated = _judged_of_study(of, log, promise)
        promise_text = "nothing was promised" if promise is None else f"promise {promise:g}"
    else:
        from pipeline.online.site import Site

        site = Site.open(Path(of), level=False)
        site.check(promise)
        tell_cold()
        targets = site.targets
        judged = _judged_of_log(site, of, log, lidar_of(body_T_lidar), promise)
        simulated = site.description.simulated
        promise_text = "nothing was promised"
        if promise is not None:
            promise_text = f"rejected from {site.promises[promise][0]:.3f} on (promise {promise:g})"
    fixes = list(judged)
    misjudged_fixes = cards.failures(fixes)
    out.mkdir(parents=True, exist_ok=True)
    for number, fix in enumerate(misjudged_fixes[:worst], start=1):
        cards.draw(
            targets,
            fix,
            out / f"{number:03d}_{fix.file_name}",
            promise_text + ", simulated" * simulated,
        )
    accepted_wrong = sum(fix.accepted for fix in misjudged_fixes)
    rejected_right = len(misjudged_fixes) - accepted_wrong
    summary = (
        f"of {len(fixes)} poses {accepted_wrong} were accepted though wrong, {rejected_right} "
        "rejected though right"
    )
    print(f"{out}: {summary}; {min(len(misjudged_fixes), worst)} drawn there")


def _judged_of_log(
    site: "Site",
    name: str,
    log: str | None,
    body_T_lidar: "Poses | None",
    promise: float | None,
) -> "Iterator[JudgedFix]":
    """Localises the scans of a log that have a true pose."""
    import numpy as np

    from pipeline.online.failures import of_log
    from pipeline.online.inputs import scans

    if log is None:
        raise ConfigError(f"{name} is a site: say which log, `yearloc failures {name} LOG`")
    skipped: Counter[str] = Counter()
    scan_options = (
        site.description.reader,
        site.description.sensor.lift_m,
        None,
        None,
        skipped,
        body_T_lidar,
    )
    log_scans = scans(log, *scan_options)
    posed_scans = [scan for scan in log_scans if np.isfinite(scan.world_T_scan).all()]
    if left_out := left_out_text(skipped):
        print(f"  {left_out}", file=sys.stderr)
    if not posed_scans:
        raise LogError(
            f"{log}: no scan with a true pose: a log that the reader of this site's data set "
            "opens has them"
        )
    return of_log(posed_scans, [site.localize(scan.points(), promise) for scan in posed_scans])


def _judged_of_study(
    of: str, day: str | None, promise: float | None
) -> "tuple[Targets, Iterator[JudgedFix], bool]":
    """Read the map and the fixes of a study's test days, or of one of them.

    Also returns whether the study is simulated.
    """
    from itertools import chain

    from pipeline.online.failures import of_study
    from pipeline.posing.targets import Targets
    from pipeline.studies.layout import Layout

    studies = read_studies()
    (dataset, grid, name) = of.split("/")
    if dataset not in studies or grid not in studies[dataset].grid_names:
        raise ConfigError(
            f"{of}: no such file, and no such study and grid among {', '.join(studies)}"
        )
    study = studies[dataset]
    layout = Layout()
    posed_models = {model.name: model for model in study.answerers if model.posed}
    if (model := posed_models.get(name) or posed_models.get(f"{name}-pose")) is None:
        remedy = (
            f"`yearloc use {dataset} poses={name.partition('-')[0]} --add` and `dvc repro` make "
            "them"
        )
        raise ConfigError(
            f"{of}: the models with poses are {', '.join(posed_models)}"
            if posed_models
            else f"{of}: no poses; {remedy}"
        )
    days = study.asked_days
    if day not in (None, *days):
        raise ConfigError(f"{day}: expected one of {', '.join(days)}")
    fixes = (
        of_study(
            layout.answers(dataset, grid, model, asked_day),
            layout.path("scans", dataset, asked_day),
            layout.path("submaps", dataset, asked_day),
            promise,
        )
        for asked_day in ([day] if day else days)
    )
    return (
        Targets.read(layout.path("map", dataset, study.train_text)),
        chain.from_iterable(fixes),
        study.simulated,
    )
