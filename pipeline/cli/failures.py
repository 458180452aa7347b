"""`yearloc failures`: pictures of what the verdict got wrong."""

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.cli.kernels import tell_cold
from pipeline.cli.localize import left_out_text, lidar_of
from pipeline.cli.outputs import check_folder
from pipeline.cli.project import read_studies
from pipeline.errors import ConfigError, LogError

if TYPE_CHECKING:
    from pipeline.online.failures import JudgedFix
    from pipeline.online.site import Site
    from pipeline.posing.targets import Targets


def failures(args: argparse.Namespace) -> None:
    """Draw the worst misjudged fixes: of a log that a site localises, or of a study's test days."""
    from pipeline.online import failures as cards

    check_folder(args.out)
    if args.of.count("/") == 2 and not Path(args.of).exists():
        targets, judged, simulated = _judged_of_study(args)
        promise_text = (
            "nothing was promised" if args.promise is None else f"promise {args.promise:g}"
        )
    else:
        from pipeline.online.site import Site

        site = Site.open(Path(args.of))
        site.check(args.promise)
        tell_cold()
        targets = site.targets
        judged = _judged_of_log(args, site)
        simulated = site.about["simulated"]
        promise_text = "nothing was promised"
        if args.promise is not None:
            promise_text = (
                f"rejected from {site.promises[args.promise][0]:.3f} on (promise {args.promise:g})"
            )
    fixes = list(judged)
    misjudged_fixes = cards.failures(fixes)
    args.out.mkdir(parents=True, exist_ok=True)
    for number, fix in enumerate(misjudged_fixes[: args.worst], start=1):
        cards.draw(
            targets,
            fix,
            args.out / f"{number:03d}_{fix.file_name}",
            promise_text + ", simulated" * simulated,
        )
    accepted_wrong = sum(fix.accepted for fix in misjudged_fixes)
    rejected_right = len(misjudged_fixes) - accepted_wrong
    summary = (
        f"of {len(fixes)} poses {accepted_wrong} were accepted though wrong, {rejected_right} "
        "rejected though right"
    )
    print(f"{args.out}: {summary}; {min(len(misjudged_fixes), args.worst)} drawn there")


def _judged_of_log(args: argparse.Namespace, site: "Site") -> "Iterator[JudgedFix]":
    """Localises the scans of a log that have a true pose."""
    import numpy as np

    from pipeline.online.failures import of_log
    from pipeline.online.inputs import scans

    if args.log is None:
        raise ConfigError(f"{args.of} is a site: say which log, `yearloc failures {args.of} LOG`")
    skipped: Counter[str] = Counter()
    scan_options = (
        site.about["reader"],
        site.about["sensor"]["lift_m"],
        None,
        None,
        skipped,
        lidar_of(args),
    )
    log_scans = scans(args.log, *scan_options)
    posed_scans = [scan for scan in log_scans if np.isfinite(scan.world_T_scan).all()]
    if left_out := left_out_text(skipped):
        print(f"  {left_out}", file=sys.stderr)
    if not posed_scans:
        raise LogError(
            f"{args.log}: no scan with a true pose: a log that the reader of this site's data set "
            "opens has them"
        )
    return of_log(posed_scans, [site.localize(scan.points(), args.promise) for scan in posed_scans])


def _judged_of_study(args: argparse.Namespace) -> "tuple[Targets, Iterator[JudgedFix], bool]":
    """Read the map and the fixes of a study's test days, or of one of them.

    Also returns whether the study is simulated.
    """
    from itertools import chain

    from pipeline.online.failures import of_study
    from pipeline.posing.targets import Targets
    from pipeline.studies.layout import Layout

    studies = read_studies()
    (dataset, grid, name) = args.of.split("/")
    if dataset not in studies or grid not in studies[dataset].grid_names:
        raise ConfigError(
            f"{args.of}: no such file, and no such study and grid among {', '.join(studies)}"
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
            f"{args.of}: the models with poses are {', '.join(posed_models)}"
            if posed_models
            else f"{args.of}: no poses; {remedy}"
        )
    days = study.asked_days
    if args.log not in (None, *days):
        raise ConfigError(f"{args.log}: expected one of {', '.join(days)}")
    fixes = (
        of_study(
            layout.answers(dataset, grid, model, day),
            layout.path("scans", dataset, day),
            layout.path("submaps", dataset, day),
            args.promise,
        )
        for day in ([args.log] if args.log else days)
    )
    return (
        Targets.read(layout.path("map", dataset, study.train_text)),
        chain.from_iterable(fixes),
        study.simulated,
    )
