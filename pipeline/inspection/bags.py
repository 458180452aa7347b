"""ROS bags: topics, types, counts, rates, frames and time span, and a proposed yaml of the data set."""

from collections.abc import Sequence
from pathlib import Path

from pipeline.errors import LogError
from pipeline.formats.bag_file import find, plain
from pipeline.inspection.bag_contents import Contents
from pipeline.inspection.bag_proposal import propose
from pipeline.inspection.inspection import Inspection, Section, duration, moment, nbytes, typographic
from pipeline.inspection.origin import size
from pipeline.readers.bag_poses import Tree


def below(path: Path) -> list[Path]:
    """The bags at `path`, right below it, or in the folders below it; an empty list where there are none."""
    found = find(path)
    if not found and path.is_dir():
        found = [bag for child in sorted(path.iterdir()) for bag in find(child)]
    return found


def bags(path: Path) -> Inspection:
    """A bag, or a folder of bags; raises LogError where none can be read."""
    paths = below(path)
    contents = Contents.read(paths)
    start_ns, end_ns = contents.span_ns
    rows = [("bags", f"{len(paths)}, {nbytes(sum(map(size, paths)))}: {', '.join(bag.name for bag in paths):.400}")]
    rows += [("from", moment(start_ns)), ("span", duration((end_ns - start_ns) * 1e-9))] if end_ns > start_ns else []
    topics: list[tuple[str, ...]] = [("topic", "messages", "rate", "type and frames")]
    for topic in contents.topics:
        frames = f", in {topic.frame}" if topic.frame else ""
        frames += f", of {topic.child}" if topic.child else ""
        rate = f"{topic.rate_hz:.3g} a second" if topic.rate_hz > 0 else "–"
        topics.append((plain(topic.name, 60), f"{topic.count:,}", rate, plain(topic.kind, 60).replace("/msg/", "/") + frames))
    sections = [Section("", tuple(rows)), Section("topics", tuple(topics))]
    if contents.tree.edges:
        sections.append(Section("transforms", _edges(contents.tree)))
    warnings = tuple(f"left aside: {line}" for line in contents.broken)
    try:
        proposed = propose(contents)
    except LogError as error:
        return Inspection(f"{path} — ROS bag", tuple(sections), (*warnings, str(error)))
    lines = tuple((line,) for line in proposed.text.splitlines())
    sections.append(Section("proposed for conf/dataset; root is the folder that the bags lie in", lines))
    return Inspection(f"{path} — ROS bag{'s' if len(paths) > 1 else ''}", tuple(sections), (*warnings, *proposed.warnings))


def proposal(paths: Sequence[Path]) -> str:
    """The text of a file for conf/dataset, for bags or folders of bags; raises LogError where they hold no points."""
    found = [bag for path in paths for bag in below(path)]
    if not found:
        raise LogError(f"{', '.join(map(str, paths))}: no bag there")
    return propose(Contents.read(found)).text


def _edges(tree: Tree) -> tuple[tuple[str, ...], ...]:
    rows: list[tuple[str, ...]] = []
    for (parent, child), (stamps_ns, poses) in sorted(tree.edges.items()):
        x, y, z = poses[-1, :3, 3]
        fixed = typographic(f"fixed, at x {x:.3f}, y {y:.3f}, z {z:.3f} m")
        rows.append((f"{parent} > {child}", f"{len(stamps_ns):,}", "moves" if tree.moves(parent, child) else fixed))
    return tuple(rows)
