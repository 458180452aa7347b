"""Reads scans for a site as the options of `localize`, `watch`, `update` and `failures` say."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.cli.options import lidar_of
from pipeline.core.errors import ConfigError

if TYPE_CHECKING:  # at run time these would slow the start of every command
    from pipeline.cli.summary import Summary
    from pipeline.online.inputs import Scan, ScanOptions
    from pipeline.online.site import Site
    from pipeline.posing.prior import Prior


def scan_options(
    site: "Site",
    topic: str | None = None,
    odometry: str | None = None,
    body_T_lidar: str | None = None,
    lift_m: float | None = None,
    gnss: str | None = None,
) -> "ScanOptions":
    """How scans are read for a site, from the values of the command line's options.

    Raises ConfigError for a `body_T_lidar` that is not of the form x,y,z,roll,pitch,yaw, and for
    `gnss` in a site without a datum.
    """
    from pipeline.online.inputs import ScanOptions

    datum = site.description.datum
    if gnss is not None and datum is None:
        raise ConfigError(
            f"--gnss {gnss}: {site.name} has no datum; pack the site with "
            "--datum LAT,LON,ALT,HEADING"
        )
    return ScanOptions(
        reader=site.description.reader,
        lift_m=site.description.sensor.lift_m if lift_m is None else lift_m,
        topic=topic,
        odometry=odometry,
        body_T_lidar=lidar_of(body_T_lidar),
        message=site.message,
        gnss=gnss,
        datum=datum,
    )


def prior_of(prior: str | None, sigma: str | None) -> "Prior | None":
    """The prior of `--prior` and `--prior-sigma`; None without them.

    Raises InputError for values that are no prior.
    """
    from pipeline.online.inputs import parse_prior

    return parse_prior("--prior", prior, "--prior-sigma", sigma)


def scans_or_followed(
    options: "ScanOptions", path: str, follow: bool, idle_s: float, summary: "Summary"
) -> "Iterator[Scan]":
    """The scans of a finished input, or with `follow` those of a recording under way.

    A recording ends when `idle_s` pass without a byte. Scans that are left out or dropped are
    counted in the summary.
    """
    if not follow:
        yield from options.scans(path, summary.skipped)
        return
    from pipeline.online.follow import Following

    recording = Following(Path(path), options, idle_s)
    yield from recording.scans()
    summary.dropped += recording.dropped
    summary.skipped += recording.skipped
    if recording.damage:
        summary.broken.append(recording.damage)


def told_kept(site: "Site", target_precision: float | None, strict: bool) -> float | None:
    """The precision that the site keeps if this one is wanted, after a line if it is another.

    Raises InputError for another one if `strict`.
    """
    kept = site.kept_precision(target_precision, strict)
    tell_kept(site.kept_words(target_precision))
    return kept


def tell_kept(words: str | None) -> None:
    """Print the line that says which precision is kept instead of the wanted one, if any."""
    if words:
        print(f"{words} (--strict refuses instead)", file=sys.stderr)


def check_site(site: "Site", odometry: str | None, track: bool, follow: bool) -> None:
    """Raise ConfigError for options of `localize` and `watch` that do not apply to this site."""
    if odometry and not track and not site.gathers:
        raise ConfigError(f"--odometry {odometry}: needs --track")
    if site.is_level and follow:
        raise ConfigError("--follow: follows 3-D scans, and the site is level")
