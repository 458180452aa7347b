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


def failures(given: argparse.Namespace) -> None:
    """Draw the worst fixes of a log that a site localises, or of a study's own test sequences."""
    from pipeline.online import failures as cards

    check_folder(given.out)
    if given.of.count("/") == 2 and not Path(given.of).exists():
        targets, judged, simulated = _judged_of_study(given)
        told = "nothing was promised" if given.promise is None else f"promise {given.promise:g}"
    else:
        from pipeline.online.site import Site

        site = Site.open(Path(given.of))
        site.check(given.promise)
        tell_cold()
        targets = site.targets
        judged = _judged_of_log(given, site)
        simulated = site.about["simulated"]
        told = "nothing was promised"
        if given.promise is not None:
            told = (
                f"rejected from {site.promises[given.promise][0]:.3f} on (promise "
                f"{given.promise:g})"
            )
    every = list(judged)
    found = cards.failures(every)
    given.out.mkdir(parents=True, exist_ok=True)
    for number, one in enumerate(found[: given.worst], start=1):
        cards.draw(
            targets,
            one,
            given.out / f"{number:03d}_{one.file_name}",
            told + ", simulated" * simulated,
        )
    wrong = sum(one.accepted for one in found)
    counted = (
        f"of {len(every)} poses {wrong} were accepted though wrong, {len(found) - wrong} rejected "
        "though right"
    )
    print(f"{given.out}: {counted}; {min(len(found), given.worst)} drawn there")


def _judged_of_log(given: argparse.Namespace, site: "Site") -> "Iterator[JudgedFix]":
    """Localises the scans of a log that have a true pose."""
    import numpy as np

    from pipeline.online.failures import of_log
    from pipeline.online.inputs import scans

    if given.log is None:
        raise ConfigError(f"{given.of} is a site: say which log, `yearloc failures {given.of} LOG`")
    skipped: Counter[str] = Counter()
    how = (
        site.about["reader"],
        site.about["sensor"]["lift_m"],
        None,
        None,
        skipped,
        lidar_of(given),
    )
    every = scans(given.log, *how)
    log = [scan for scan in every if np.isfinite(scan.world_T_scan).all()]
    if left_out := left_out_text(skipped):
        print(f"  {left_out}", file=sys.stderr)
    if not log:
        raise LogError(
            f"{given.log}: no scan with a true pose: a log that the reader of this site's data set "
            "opens has them"
        )
    return of_log(log, [site.localize(scan.points(), given.promise) for scan in log])


def _judged_of_study(given: argparse.Namespace) -> "tuple[Targets, Iterator[JudgedFix], bool]":
    """The map, the fixes of a study's test sequences, or of one of them, and whether they are
    simulated."""
    from itertools import chain

    from pipeline.online.failures import of_study
    from pipeline.posing.targets import Targets
    from pipeline.studies.expansion import answerers, folder

    studies = read_studies()
    (dataset, grid, name) = given.of.split("/")
    if dataset not in studies or grid not in studies[dataset]["grids"]:
        raise ConfigError(
            f"{given.of}: no such file, and no such study and grid among {', '.join(studies)}"
        )
    study = studies[dataset]
    root = Path("artifacts")
    posed = {one.name: one for one in answerers(study) if one.posed}
    if (own := posed.get(name) or posed.get(f"{name}-pose")) is None:
        ask = (
            f"`yearloc use {dataset} poses={name.partition('-')[0]} --add` and `dvc repro` make "
            "them"
        )
        raise ConfigError(
            f"{given.of}: the models with poses are {', '.join(posed)}"
            if posed
            else f"{given.of}: no poses; {ask}"
        )
    days = [*study["tests"], *study.get("stress", {})]
    if given.log not in (None, *days):
        raise ConfigError(f"{given.log}: expected one of {', '.join(days)}")
    poses, scans, submaps = (
        root / part
        for part in (folder(dataset, grid, own), f"scans/{dataset}", f"submaps/{dataset}")
    )
    names = [f"{day}.zarr" for day in ([given.log] if given.log else days)]
    each = (of_study(poses / name, scans / name, submaps / name, given.promise) for name in names)
    return (
        Targets.read(root / "map" / dataset / f"{study['train']}.zarr"),
        chain.from_iterable(each),
        study["source"] == "world",
    )
