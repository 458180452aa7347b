"""`yearloc localize` says where scans were taken: a pose and a verdict for each of them.

It reads a site (one file with all that it takes to localise in a place) and scans from files, logs,
bags or a recording under way, and writes text, JSON, CSV or a trajectory. The verdict says at a
target precision whether to accept the pose.
"""

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.kernels import tell_cold
from pipeline.cli.options import (
    BodyTLidar,
    Follow,
    Gnss,
    Idle,
    Odometry,
    PriorSigma,
    PriorText,
    SitePath,
    Strict,
    TargetPrecision,
    Topic,
    Track,
    only_one,
)
from pipeline.cli.outputs import check_file
from pipeline.cli.scan_options import (
    check_site,
    prior_of,
    scan_options,
    scans_or_followed,
    told_kept,
)
from pipeline.cli.summary import Summary
from pipeline.core.errors import ConfigError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    import numpy as np
    from numpy.typing import NDArray

    from pipeline.core.frames import Poses
    from pipeline.online.inputs import ScanOptions
    from pipeline.online.site import Site

Inputs = Annotated[
    list[str],
    typer.Argument(
        metavar="INPUT",
        help="Scans (.bin .npy .pcd), folders of scans, logs or bags; - reads one scan from "
        "standard input",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Write one JSON object per scan and line")]
Csv = Annotated[bool, typer.Option("--csv", help="Write one CSV row per scan")]
Tum = Annotated[
    bool, typer.Option("--tum", help="Write the accepted poses as a trajectory in TUM's format")
]
Mcap = Annotated[
    bool,
    typer.Option(
        "--mcap", help="Write the accepted poses as PoseWithCovarianceStamped, for Foxglove"
    ),
]
Out = Annotated[
    Path | None,
    typer.Option(
        "-o", "--out", metavar="FILE", help="Write to this file instead of standard output"
    ),
]
Lift = Annotated[
    float | None,
    typer.Option(
        metavar="M",
        help="Raise the points by M metres, so that the ground is at z = 0; by default as the "
        "site was trained; not for logs of the site's data set",
    ),
]
Threads = Annotated[int, typer.Option(metavar="N", help="Threads that the network may use")]


def localize(
    path: SitePath,
    inputs: Inputs,
    json: Json = False,
    csv: Csv = False,
    tum: Tum = False,
    mcap: Mcap = False,
    out: Out = None,
    target_precision: TargetPrecision = 0.99,
    strict: Strict = False,
    lift: Lift = None,
    body_T_lidar: BodyTLidar = None,
    topic: Topic = None,
    odometry: Odometry = None,
    prior: PriorText = None,
    prior_sigma: PriorSigma = None,
    gnss: Gnss = None,
    track: Track = False,
    follow: Follow = False,
    idle: Idle = 10.0,
    threads: Threads = 1,
) -> None:
    """Localise scans by a site file: a pose for each scan, and whether to accept it."""
    with _without_garbage_collection():
        from pipeline.online.localized import localized, tracker_of
        from pipeline.online.outputs import writer
        from pipeline.online.site import Site

    output_format = only_one({"json": json, "csv": csv, "tum": tum, "mcap": mcap}) or "text"
    only_one({"lift": lift, "body-T-lidar": body_T_lidar})
    only_one({"prior": prior, "gnss": gnss})
    only_one({"follow": follow, "gnss": gnss})
    if threads < 1:
        raise ConfigError(f"--threads {threads}: expected at least 1")
    site = Site.open(path, threads)
    check_site(site, odometry, track, follow)
    check_file(out, is_written_whole=output_format == "mcap")
    target_precision = told_kept(site, target_precision, strict)
    options = scan_options(
        site, topic=topic, odometry=odometry, body_T_lidar=body_T_lidar, lift_m=lift, gnss=gnss
    )
    if lift is not None and not follow:
        _check_lift(options, inputs)
    summary = Summary(site.claim_judge.tolerances)
    believed = prior_of(prior, prior_sigma)
    tracker = tracker_of(site, target_precision, track)
    tell_cold()
    priors = 0
    with writer(output_format, out) as write:
        for source in inputs:
            scans = scans_or_followed(options, source, follow, idle, summary)
            # `localized` appends to `broken` why a scan could not be read
            for scan, points_m, fix in localized(
                scans, tracker or site, target_precision, summary.broken, believed
            ):
                is_first = not summary.verdicts
                if is_first:
                    _warn_if_unlike(points_m, site, scan.body_T_lidar)
                write(scan, fix)
                summary.add(scan, fix)
                priors += scan.prior is not None
    summary.check_any(" ".join(inputs))
    if tracker:
        summary.steps = tracker.steps
    summary.tell()
    if gnss:
        print(f"--gnss {gnss}: a prior for {priors} of the scans", file=sys.stderr)
    if site.description.simulated:
        print("the site is simulated, not recorded", file=sys.stderr)
    if target_precision in site.description.verdict.usual:
        print(_not_calibrated(site, path), file=sys.stderr)


def _not_calibrated(site: "Site", path: Path) -> str:
    """Says that poses were accepted by the usual thresholds, and what to do."""
    from pipeline.posing.map_verdict import NOT_CALIBRATED

    verdict = site.description.verdict
    others = [precision for precision in verdict.reachable if precision not in verdict.usual]
    if verdict.validation_blocks:
        learned = f"; --target-precision {others[0]} is learned from them" if others else ""
        return (
            f"{NOT_CALIBRATED} at this target precision: the {verdict.validation_blocks} "
            f"validation blocks of {site.description.provenance.calibrated_on} are too few{learned}"
        )
    return (
        f"{NOT_CALIBRATED}: poses are accepted by the usual probabilities, learned elsewhere, at "
        f"{min(verdict.usual)} more of them than at {max(verdict.usual)}; `yearloc calibrate "
        f"{path} LOG` learns them from a drive"
    )


@contextmanager
def _without_garbage_collection() -> Iterator[None]:
    """Import without garbage collection, which finds none and is a tenth of the start-up time."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()  # modules stay, so no later collection needs to search them
        gc.enable()


def _check_lift(options: "ScanOptions", inputs: list[str]) -> None:
    """Raise ConfigError for `--lift` with a log, whose points the site's reader raises itself."""
    for source in inputs:
        if options.is_log(source):
            raise ConfigError(
                f"--lift {options.lift_m:g}: {source} is a log of the site's data set, whose "
                "reader raises its points"
            )


def _warn_if_unlike(
    points_m: "NDArray[np.float64]", site: "Site", body_T_lidar: "Poses | None"
) -> None:
    """Print how the points (n, 3) of a scan differ from the scans that the site learned.

    `body_T_lidar` (4, 4) is the pose of the lidar in the scan, None if it is unknown.
    """
    for difference in site.unlike(points_m, body_T_lidar):
        print(
            f"yearloc localize: unlike the scans that the site was learned with: {difference}",
            file=sys.stderr,
        )
