"""`yearloc failures` draws a picture of each fix that the verdict got wrong.

A fix is the pose that was found for a scan. Its verdict is wrong if it is accepted though wrong, or
rejected though right. The fixes are those of a study's test days, or of a site (one file with all
that it takes to localise in a place) that localises a log whose true poses are known.
"""

from collections import Counter
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.options import BodyTLidar, Strict, TargetPrecision
from pipeline.cli.outputs import check_folder
from pipeline.cli.project import named_model
from pipeline.cli.scan_options import scan_options, tell_kept, told_kept
from pipeline.cli.summary import tell_left_out
from pipeline.cli.update import POSES_OF_LOG, reference_poses
from pipeline.core.errors import ConfigError, LogError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from pipeline.evaluation.failures import JudgedFix
    from pipeline.posing.targets import Targets
    from pipeline.studies.models import ModelName
    from pipeline.studies.study import Study

SiteOrModel = Annotated[
    str,
    typer.Argument(
        metavar="SITE|STUDY/GRID/METHOD",
        help="A site file, or a model of a study whose answers have poses",
    ),
]
LogOrDay = Annotated[
    str | None,
    typer.Argument(
        metavar="LOG|DAY",
        help="With a site: a log with true poses. With a study: one test day, by default all",
    ),
]
Worst = Annotated[
    int, typer.Option(metavar="N", help="Draw at most N pictures, the worst fixes first")
]
Out = Annotated[
    Path, typer.Option("-o", "--out", metavar="FOLDER", help="The folder for the pictures")
]


Poses = Annotated[
    str | None,
    typer.Option(
        "--poses",
        metavar="FILE",
        help="Of a site: the true poses, a TUM trajectory or KITTI poses of one row a scan; by "
        "default the log's own",
    ),
]


@dataclass(frozen=True)
class JudgedFixes:
    """The fixes of a log or of a study's test days, and the map that they lie in."""

    fixes: "list[JudgedFix]"
    targets: "Targets"
    """The submaps of the map."""
    precision_text: str
    """The target precision of the verdicts, in words, for the heading of each picture."""
    notes: tuple[str, ...]


def failures(
    of: SiteOrModel,
    log: LogOrDay = None,
    body_T_lidar: BodyTLidar = None,
    poses: Poses = None,
    worst: Worst = 20,
    out: Out = Path("failures"),
    target_precision: TargetPrecision = 0.99,
    strict: Strict = False,
) -> None:
    """Draw each fix whose verdict is wrong: accepted though wrong, or rejected though right."""
    from pipeline.evaluation.failures import failures as failed
    from pipeline.online.failures import draw

    check_folder(out)
    if of.count("/") == 2 and not Path(of).exists():
        judged = _judged_of_study(of, log, target_precision, strict)
    else:
        judged = _judged_of_site(of, log, poses, body_T_lidar, target_precision, strict)
    misjudged_fixes = failed(judged.fixes)
    out.mkdir(parents=True, exist_ok=True)
    heading_end = ", ".join((judged.precision_text, *judged.notes))
    for number, fix in enumerate(misjudged_fixes[:worst], start=1):
        draw(judged.targets, fix, out / f"{number:03d}_{fix.file_name}", heading_end)
    n_accepted_wrong = sum(fix.accepted for fix in misjudged_fixes)
    n_rejected_right = len(misjudged_fixes) - n_accepted_wrong
    print(
        f"{out}: of {len(judged.fixes)} poses {n_accepted_wrong} were accepted though wrong, "
        f"{n_rejected_right} rejected though right; {min(len(misjudged_fixes), worst)} drawn there"
    )


def _judged_of_site(
    name: str,
    log: str | None,
    poses: str | None,
    body_T_lidar: str | None,
    target_precision: float | None,
    strict: bool,
) -> JudgedFixes:
    """Localise the scans of a log that have a true pose by a site file."""
    import numpy as np

    from pipeline.online.failures import of_log
    from pipeline.online.site import Site
    from pipeline.online.site_json import notes

    site = Site.open(Path(name), level=False)
    target_precision = told_kept(site, target_precision, strict)
    tell_cold()
    options = scan_options(site, body_T_lidar=body_T_lidar)
    if log is None:
        raise ConfigError(f"{name} is a site: say which log, `yearloc failures {name} LOG`")
    skipped: Counter[str] = Counter()
    scans = list(options.scans(log, skipped))
    tell_left_out(skipped)
    world_T_scan = reference_poses(poses or POSES_OF_LOG, scans)
    scans = [
        replace(scan, world_T_scan=pose)
        for scan, pose in zip(scans, world_T_scan, strict=True)
        if np.isfinite(pose).all()
    ]
    if not scans:
        raise LogError(
            f"{log}: no scan with a true pose: give --poses, or a log that the reader of this "
            "site's data set opens"
        )
    fixes = [site.localize(scan.points(), target_precision) for scan in scans]
    precision_text = "no pose is accepted"
    if target_precision is not None:
        # the error probability from which a pose is rejected
        pose_threshold, *_ = site.target_precisions[target_precision]
        precision_text = (
            f"rejected from {pose_threshold:.3f} on (target precision {target_precision:g})"
        )
    return JudgedFixes(
        list(of_log(scans, fixes)), site.targets, precision_text, notes(site.description)
    )


def _judged_of_study(
    name: str, day: str | None, target_precision: float | None, strict: bool
) -> JudgedFixes:
    """Read the fixes of STUDY/GRID/METHOD on one test day, or on all test days."""
    from pipeline.core import store
    from pipeline.core.precisions import kept_precision, kept_words
    from pipeline.core.schemas import Fixes
    from pipeline.evaluation.failures import of_drive, reject_from, target_precisions
    from pipeline.mapping.from_above import Drive
    from pipeline.posing.cut_outs import read_targets
    from pipeline.studies.layout import Layout

    study, grid, method = named_model(name)
    model = _posed_model(study, method, name)
    if day not in (None, *study.query_days):
        raise ConfigError(f"{day}: expected one of {', '.join(study.query_days)}")
    layout = Layout()
    fixes: list[JudgedFix] = []
    precision_text = "no pose is accepted"
    is_told = False
    for test_day in [day] if day else study.query_days:
        answers = store.read(layout.answers(study.name, grid, model, test_day), Fixes)
        drive = Drive.read(
            layout.path("scans", study.name, test_day), layout.path("submaps", study.name, test_day)
        )
        threshold = reject_from(answers, target_precision, strict)
        fixes += of_drive(answers, drive, threshold, f"{test_day} query {{}}")
        # the thresholds of all test days are those of the same validation blocks
        if not is_told:
            tell_kept(kept_words("this model", target_precisions(answers), target_precision))
            is_told = True
        kept = kept_precision(target_precisions(answers), target_precision)
        if kept is not None:
            precision_text = f"target precision {kept:g}"
    return JudgedFixes(
        fixes,
        read_targets(layout.path("map", study.name, study.train_text)),
        precision_text,
        ("simulated",) if study.simulated else (),
    )


def _posed_model(study: "Study", method: str, name: str) -> "ModelName":
    """The model of STUDY/GRID/METHOD whose answers have poses; METHOD may lack the ending -pose."""
    posed_models = {model.name: model for model in study.answerers if model.posed}
    model = posed_models.get(method) or posed_models.get(f"{method}-pose")
    if model is not None:
        return model
    if posed_models:
        raise ConfigError(f"{name}: the models with poses are {', '.join(posed_models)}")
    method = method.partition("-")[0]
    remedy = f"`yearloc use {study.name} poses={method} --add` and `dvc repro` make them"
    raise ConfigError(f"{name}: no poses; {remedy}")
