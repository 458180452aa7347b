"""ROS bags: topics, types, counts, rates, frames and time span, and a proposed yaml of the data
set."""

from collections.abc import Sequence
from pathlib import Path

import yaml

from pipeline.errors import LogError
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
    """The bags at `path`, right below it, or in the folders below it; an empty list where there are
    none."""
    children = sorted(path.iterdir()) if path.is_dir() else []
    return find(path) or [bag for child in children for bag in find(child)]


def bags(path: Path, found: Inspection) -> None:
    """A bag, or a folder of bags; raises LogError where none can be read."""
    paths = below(path)
    contents = Contents.read(paths)
    start_ns, end_ns = contents.span_ns
    span = (
        [("from", moment(start_ns)), ("span", duration((end_ns - start_ns) * 1e-9))]
        if end_ns > start_ns
        else []
    )
    held = (
        "bags",
        f"{len(paths)}, {nbytes(sum(map(size, paths)))}: "
        f"{', '.join(bag.name for bag in paths):.400}",
    )
    found.describe("ROS bag", held, *span)
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
    found.add("topics", *topics)
    transforms = []
    for (parent, child), (stamps_ns, poses) in sorted(contents.tree.edges.items()):
        fixed = typographic("fixed, at x {:.3f}, y {:.3f}, z {:.3f} m".format(*poses[-1, :3, 3]))
        how = "moves" if contents.tree.moves(parent, child) else fixed
        transforms.append((f"{parent} > {child}", f"{len(stamps_ns):,}", how))
    if transforms:
        found.add("transforms", *transforms)
    found.warnings += tuple(f"left aside: {line}" for line in contents.broken)
    try:
        text, warnings = propose(contents)
    except LogError as error:
        found.warn(True, str(error))
        return
    found.kind = f"ROS bag{'s' if len(paths) > 1 else ''}"
    found.add(
        "proposed for conf/dataset; root is the folder that the bags lie in",
        *((line,) for line in text.splitlines()),
    )
    found.warnings += tuple(warnings)
    if not any("body_T_lidar" in warning for warning in warnings):  # that has to be given first
        _try(path, text, contents, found)


def _try(path: Path, text: str, contents: Contents, found: Inspection) -> None:
    """Open the bag as the proposed yaml says and look at a few clouds; what its reader refuses is a
    warning."""
    reader = yaml.safe_load(text)["reader"]
    del reader["_target_"]
    if reader["truth"] is None:
        return
    whole = path.resolve()
    drive = (
        whole if is_bag(whole) else next(child for child in sorted(whole.iterdir()) if find(child))
    )
    held = sum(map(size, find(drive)))
    if held > TRIED_BYTES:
        found.warn(
            True, f"not tried: {nbytes(held)} of {drive.name} would be read to open it as proposed"
        )
        return
    try:
        log = Bag(**reader).open(drive.parent, drive.name)
        describe_log(found, log, f"{drive.name}, as its reader opens it", "messages")
        if any(topic.name == reader["points"] for topic in contents.of(CLOUD)):
            survey_log(found, log, VEHICLE)
    except LogError as error:
        found.warn(True, f"the reader refuses the bag as proposed: {error}")


def proposal(paths: Sequence[Path]) -> str:
    """The text of a file for conf/dataset, for bags or folders of bags; raises LogError where they
    hold no points."""
    found = [bag for path in paths for bag in below(path)]
    if not found:
        raise LogError(f"{', '.join(map(str, paths))}: no bag there")
    return propose(Contents.read(found))[0]
