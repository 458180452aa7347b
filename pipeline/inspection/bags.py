"""Describes ROS bags, and proposes a yaml of the data set.

Topics with types, counts, rates and frames, the transforms, and the time span.
"""

from collections.abc import Sequence
from pathlib import Path

import yaml

from pipeline.core.errors import LogError
from pipeline.formats.bag import CLOUD
from pipeline.formats.bag_file import find, is_bag, plain
from pipeline.inspection.bag_contents import Contents
from pipeline.inspection.bag_proposal import propose
from pipeline.inspection.drives import VEHICLE
from pipeline.inspection.folders import describe_log, survey_log
from pipeline.inspection.inspection import Inspection, duration, moment, nbytes, typographic
from pipeline.inspection.origin import size
from pipeline.readers.bag import Bag

TRIED_BYTES = 8 * 10**9
"""A drive's bags of more bytes are not opened to see whether the proposed yaml works."""


def below(path: Path) -> list[Path]:
    """The bags at `path`, right below it, or in the folders below it; may be empty."""
    children = sorted(path.iterdir()) if path.is_dir() else []
    return find(path) or [bag for child in children for bag in find(child)]


def bags(path: Path, inspection: Inspection) -> None:
    """Describe a bag, or a folder of bags; raises LogError where none can be read."""
    paths = below(path)
    contents = Contents.read(paths)
    start_ns, end_ns = contents.span_ns
    span = (
        [("from", moment(start_ns)), ("span", duration((end_ns - start_ns) * 1e-9))]
        if end_ns > start_ns
        else []
    )
    bags_row = (
        "bags",
        f"{len(paths)}, {nbytes(sum(map(size, paths)))}: "
        f"{', '.join(bag.name for bag in paths):.400}",
    )
    inspection.describe("ROS bag", bags_row, *span)
    topics: list[tuple[str, ...]] = [("topic", "messages", "rate", "type and frames")]
    for topic in contents.topics:
        frames = (f", in {topic.frame}" if topic.frame else "") + (
            f", of {topic.child}" if topic.child else ""
        )
        rate = f"{topic.rate_hz:.3g} a second" if topic.rate_hz > 0 else "–"
        topics.append(
            (
                plain(topic.name, 60),
                f"{topic.count:,}",
                rate,
                plain(topic.kind, 60).replace("/msg/", "/") + frames,
            )
        )
    inspection.add("topics", *topics)
    transforms = []
    for (parent, child), (stamps_ns, poses) in sorted(contents.tree.edges.items()):
        fixed_text = typographic(
            "fixed, at x {:.3f}, y {:.3f}, z {:.3f} m".format(*poses[-1, :3, 3])
        )
        motion = "moves" if contents.tree.moves(parent, child) else fixed_text
        transforms.append((f"{parent} > {child}", f"{len(stamps_ns):,}", motion))
    if transforms:
        inspection.add("transforms", *transforms)
    inspection.warnings += tuple(f"left aside: {line}" for line in contents.broken)
    try:
        text, warnings = propose(contents)
    except LogError as error:
        inspection.warn(True, str(error))
        return
    inspection.kind = f"ROS bag{'s' if len(paths) > 1 else ''}"
    inspection.add(
        "proposed for conf/dataset; root is the folder that the bags lie in",
        *((line,) for line in text.splitlines()),
    )
    inspection.warnings += tuple(warnings)
    if not any("body_T_lidar" in warning for warning in warnings):  # that has to be given first
        _try(path, text, contents, inspection)


def _try(path: Path, text: str, contents: Contents, inspection: Inspection) -> None:
    """Open the bag as the proposed yaml says and look at a few clouds.

    Where the reader refuses the bag, its error becomes a warning.
    """
    reader = yaml.safe_load(text)["reader"]
    del reader["_target_"]
    if reader["truth"] is None and not contents.of(CLOUD):
        return
    full_path = path.resolve()
    drive = (
        full_path
        if is_bag(full_path)
        else next(child for child in sorted(full_path.iterdir()) if find(child))
    )
    drive_bytes = sum(map(size, find(drive)))
    if drive_bytes > TRIED_BYTES:
        inspection.warn(
            True,
            f"not tried: {nbytes(drive_bytes)} of {drive.name} would be read to open it as "
            "proposed",
        )
        return
    try:
        log = Bag(**reader).open(drive.parent, drive.name)
        describe_log(inspection, log, f"{drive.name}, as its reader opens it", "messages")
        if any(topic.name == reader["points"] for topic in contents.of(CLOUD)):
            survey_log(inspection, log, VEHICLE)
    except LogError as error:
        inspection.warn(True, f"the reader refuses the bag as proposed: {error}")


def proposal(paths: Sequence[Path]) -> str:
    """The text of a file for conf/dataset, for bags or folders of bags.

    Raises LogError where they hold no points.
    """
    bag_paths = [bag for path in paths for bag in below(path)]
    if not bag_paths:
        raise LogError(f"{', '.join(map(str, paths))}: no bag there")
    return propose(Contents.read(bag_paths))[0]
