"""Describes ROS bags for `yearloc inspect`: bags in; rows of text and a proposed yaml out.

The rows list the topics with types, counts, rates and frames, the transforms, and the time span.
The proposed yaml is a file for conf/dataset with which the bags can be read; it is tried on them.
"""

from collections.abc import Sequence
from pathlib import Path

import yaml

from pipeline.core.errors import LogError
from pipeline.formats.bag import CLOUD
from pipeline.formats.bag_file import find, is_bag, plain
from pipeline.inspection.bag_proposal import propose
from pipeline.inspection.drives import VEHICLE
from pipeline.inspection.folders import describe_clouds_of, describe_log
from pipeline.inspection.inspection import Inspection, duration, moment, nbytes, typographic
from pipeline.inspection.origin import bytes_on_disk
from pipeline.opening.bag_contents import Contents
from pipeline.readers.bag import Bag

MAX_TRIED_BYTES = 8 * 10**9
"""If the bags of a drive are larger, the proposed yaml is not tried on them."""


def below(path: Path) -> list[Path]:
    """The bags at `path` or right below it, else those in the folders below it; may be empty."""
    paths = find(path)
    if paths or not path.is_dir():
        return paths
    return [bag for child in sorted(path.iterdir()) for bag in find(child)]


def describe_bags(path: Path, inspection: Inspection) -> None:
    """Describe a bag, or a folder of bags; raises LogError where none can be read."""
    paths = below(path)
    contents = Contents.read(paths)
    names = ", ".join(bag.name for bag in paths)
    size_text = nbytes(sum(map(bytes_on_disk, paths)))
    inspection.kind = "ROS bag"
    inspection.add("", ("bags", f"{len(paths)}, {size_text}: {names:.400}"), *_span_rows(contents))
    inspection.add("topics", *_topic_rows(contents))
    if transforms := _transform_rows(contents):
        inspection.add("transforms", *transforms)
    inspection.warnings += tuple(f"left aside: {line}" for line in contents.errors)
    try:
        text, warnings = propose(contents)
    except LogError as error:
        inspection.warn(str(error))
        return
    if len(paths) > 1:
        inspection.kind = "ROS bags"
    inspection.add(
        "proposed for conf/dataset; root is the folder that the bags lie in",
        *((line,) for line in text.splitlines()),
    )
    inspection.warnings += tuple(warnings)
    lacks_extrinsic = any("body_T_lidar" in warning for warning in warnings)
    if not lacks_extrinsic:
        _try(path, text, contents, inspection)


def proposal(paths: Sequence[Path]) -> str:
    """The text of a file for conf/dataset, for bags or folders of bags.

    Raises LogError where they hold no points.
    """
    bag_paths = [bag for path in paths for bag in below(path)]
    if not bag_paths:
        raise LogError(f"{', '.join(map(str, paths))}: no bag there")
    text, _ = propose(Contents.read(bag_paths))
    return text


def _span_rows(contents: Contents) -> list[tuple[str, str]]:
    """When the recording began and how long it is; no rows for an empty one."""
    start_ns, end_ns = contents.span_ns
    if end_ns <= start_ns:
        return []
    return [("from", moment(start_ns)), ("span", duration((end_ns - start_ns) * 1e-9))]


def _topic_rows(contents: Contents) -> list[tuple[str, ...]]:
    """A row for each topic, below a row of titles."""
    rows: list[tuple[str, ...]] = [("topic", "messages", "rate", "type and frames")]
    for topic in contents.topics:
        rate = f"{topic.rate_hz:.3g} a second" if topic.rate_hz > 0 else "–"
        message_type = plain(topic.kind, 60).replace("/msg/", "/")
        frame = f", in {topic.frame}" if topic.frame else ""
        child = f", of {topic.child}" if topic.child else ""
        rows.append(
            (plain(topic.name, 60), f"{topic.count:,}", rate, f"{message_type}{frame}{child}")
        )
    return rows


def _transform_rows(contents: Contents) -> list[tuple[str, ...]]:
    """A row for each transform: its frames, number of messages, and place if it is fixed."""
    rows: list[tuple[str, ...]] = []
    tree = contents.transforms.read_all()
    for (parent, child), (stamps_ns, poses) in sorted(tree.edges.items()):
        motion = "moves"
        if not tree.moves(parent, child):
            x_m, y_m, z_m = poses[-1, :3, 3].tolist()
            motion = typographic(f"fixed, at x {x_m:.3f}, y {y_m:.3f}, z {z_m:.3f} m")
        rows.append((f"{parent} > {child}", f"{len(stamps_ns):,}", motion))
    return rows


def _try(path: Path, text: str, contents: Contents, inspection: Inspection) -> None:
    """Open the bag, or the first of several drives, with the proposed yaml."""
    reader = yaml.safe_load(text)["reader"]
    del reader["_target_"]
    if reader["ground_truth"] is None and not contents.of(CLOUD):
        return
    drive = path.resolve()
    if not is_bag(drive):
        drive = next(child for child in sorted(drive.iterdir()) if find(child))
    drive_bytes = sum(map(bytes_on_disk, find(drive)))
    if drive_bytes > MAX_TRIED_BYTES:
        inspection.warn(
            f"not tried: {nbytes(drive_bytes)} of {drive.name} would be read to open it as "
            "proposed",
        )
        return
    try:
        log = Bag(**reader).open(drive.parent, drive.name)
        describe_log(inspection, log, f"{drive.name}, as its reader opens it", "messages")
        if any(topic.name == reader["points"] for topic in contents.of(CLOUD)):
            describe_clouds_of(inspection, log, VEHICLE)
    except LogError as error:
        inspection.warn(f"the reader refuses the bag as proposed: {error}")
