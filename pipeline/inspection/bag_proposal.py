"""Proposes the yaml of a data set of bags: the contents of bags in; the text of a yaml out.

It names the topics and frames for the reader, each with the reason beside it.
"""

import json
import re

import numpy as np
from numpy.typing import NDArray

from pipeline.core.errors import LogError
from pipeline.formats.bag import CLOUD, IMU, SWEEP, TRANSFORMS
from pipeline.formats.bag_file import plain
from pipeline.inspection.bag_contents import Contents, TopicSummary
from pipeline.inspection.inspection import typographic
from pipeline.mapping.appearance import ground
from pipeline.readers.bag_poses import KINDS

WORLDS = ("map", "world", "earth", "utm", "enu", "global")
"""Frames that stand still, the likeliest first."""
BODIES = ("base_footprint", "base_link", "body", "imu", "imu_link")
"""Frames that may stand for the vehicle, the likeliest first."""
TRUE = re.compile("truth|gt|gnss|gps|rtk|ins|slam|map|locali")
"""In the name of a topic with true poses."""
PACKETS = ("CustomMsg", "VelodyneScan", "PacketMsg")
"""Messages of Livox, Velodyne and Ouster that hold no PointCloud2 yet."""
DRIFTS = re.compile("odom|vo|vio|wheel")
"""In the name or frame of poses that drift."""


def propose(contents: Contents) -> tuple[str, list[str]]:
    """The text of a file for conf/dataset, and warnings for its user.

    The text names points, truth, odometry and extrinsics. Raises LogError for bags without points.
    """
    truth, odometry = _poses(contents)
    points = points_source(contents, truth)
    is_sweep = points.kind == SWEEP
    warnings: list[str] = []
    if truth is None:
        warnings.append(_without_poses(contents, is_sweep))
    elif DRIFTS.search(truth.frame):
        warnings.append(_with_odometry_alone(truth, is_sweep))
    posed = truth
    if odometry is None and (is_sweep or (truth is not None and DRIFTS.search(truth.frame))):
        odometry = truth
        truth = truth if is_sweep else None
    body_T_lidar, extrinsic = _extrinsic(contents, points, posed, warnings)
    lift_m, lift = _lift(contents, points, body_T_lidar)
    gap_s = max(0.5, round(3 / posed.rate_hz, 1)) if posed and posed.rate_hz > 0 else 0.5
    shape = "LaserScan: a row is one sweep" if is_sweep else "PointCloud2"
    name = contents.files[0].path.name
    frame = points.frame or "?"
    text = f"""\
# Proposed by `yearloc inspect` from {name}; conf/dataset/bag.yaml explains the keys.
simulated: false
reader:
  _target_: pipeline.readers.bag.Bag
  points: {_word(points.name)} # {shape}, {_rate(points.rate_hz)}, in the frame {frame}
  truth: {_source_line(truth)}
  odometry: {_source_line(odometry)}
  imu: {_imu_line(None if truth or odometry else gyroscope(contents))}
  body_T_lidar: null # {extrinsic}
  lift_m: {lift_m} # {lift}
  max_gap_s: {gap_s}
box: null
study: # name the sequences yourself: bags, or folders of bags, below the data set's root
  expected: one bag or one folder of bags a sequence
  train: null
  tests: []
  submap: {"flat" if is_sweep else "single"}
  grids: [10m]
  methods: [sci_ring, scan_context]
"""
    first_line, remainder = text.split("\n", 1)
    return "\n".join(
        [first_line, *(f"# Beware: {warning}" for warning in warnings), remainder]
    ), warnings


def _without_poses(contents: Contents, is_sweep: bool) -> str:
    """The warning on bags without any source of poses."""
    topic_list = ", ".join(
        f"{topic.name} ({topic.kind.replace('/msg/', '/')})" for topic in contents.topics
    )
    advice = (
        "sweeps of a 2-D LiDAR need an Odometry, PoseStamped, PoseWithCovarianceStamped, or "
        "moving transforms in tf beside them"
        if is_sweep
        else "`yearloc use NAME root=FOLDER train=DRIVE poses=slam` estimates them, `yearloc "
        "slam` of one drive alone"
    )
    return f"no poses: {advice}. Topics here: {plain(topic_list, 600)}"


def _with_odometry_alone(truth: TopicSummary, is_sweep: bool) -> str:
    """The warning on bags whose best source of poses drifts."""
    drift = f"the only poses are in the frame {truth.frame}, which starts anew with each drive"
    if is_sweep:
        return (
            f"{drift}: sequences share no places; a study over several drives needs poses in one "
            "frame, such as map"
        )
    return (
        f"{drift}: they are the odometry; `yearloc use NAME root=FOLDER train=DRIVE poses=slam` "
        "estimates poses in one frame from the scans. To split a single drive, "
        f"{truth.name} may be named as truth"
    )


def points_source(contents: Contents, truth: TopicSummary | None) -> TopicSummary:
    """The topic of clouds, or else of sweeps, that is most likely the LiDAR's.

    It does not lie in the world of the true poses already. Raises LogError for bags without points.
    """
    sources = contents.of(CLOUD) or contents.of(SWEEP)
    points = min(
        sources, key=lambda source: truth is not None and source.frame == truth.frame, default=None
    )
    if points is None:
        topic_list = (
            ", ".join(f"{topic.name} ({topic.kind})" for topic in contents.topics) or "nothing"
        )
        packet_kind = next(
            (topic.kind for topic in contents.topics if topic.kind.rpartition("/")[2] in PACKETS),
            "",
        )
        advice = (
            f"; let the lidar's driver make PointCloud2 of {packet_kind} while `ros2 bag record` "
            "runs"
            if packet_kind
            else ""
        )
        message = (
            "neither a PointCloud2 nor a LaserScan in it; it holds "
            f"{plain(topic_list, 800)}{advice}"
        )
        raise LogError(f"{contents.files[0].path}: {message}")
    return points


def drifting(contents: Contents) -> TopicSummary | None:
    """The source of poses that is most likely odometry, which never jumps; None without any."""
    truth, odometry = _poses(contents)
    is_odometry = truth is not None and DRIFTS.search(f"{truth.frame} {truth.name}")
    return odometry or (truth if is_odometry else None)


def gyroscope(contents: Contents) -> TopicSummary | None:
    """The most frequent topic of an IMU; None without any."""
    return next(iter(contents.of(IMU)), None)


def _poses(contents: Contents) -> tuple[TopicSummary | None, TopicSummary | None]:
    """The source of poses that is most likely the truth, and the most likely odometry of the rest.

    None where the bags hold none.
    """
    frames = sorted({frame for edge in contents.tree.edges for frame in edge})
    bodies = [body for body in BODIES if body in frames]
    trees = [
        TopicSummary(f"tf:{world}>{body}", TRANSFORMS, 0, np.nan, world, body)
        for world in (*WORLDS, "odom")
        for body in bodies[:1]
        if world in frames and contents.tree.moves(world, body)
    ]
    sources = contents.of(*KINDS) + trees
    truth = max(sources, key=_trust, default=None)
    drifting = [
        source
        for source in sources
        if source is not truth and DRIFTS.search(source.frame + " " + source.name)
    ]
    return truth, min(drifting, key=_trust, default=None)


def _trust(source: TopicSummary) -> int:
    """A score, larger for poses that are more likely the truth than odometry.

    A topic is preferred to transforms.
    """
    is_world_frame = source.frame in WORLDS
    drifts = bool(DRIFTS.search(source.frame + " " + source.name))
    return (
        8 * is_world_frame
        + 4 * bool(TRUE.search(source.name))
        - 4 * drifts
        + (not source.name.startswith("tf:"))
    )


def _extrinsic(
    contents: Contents, points: TopicSummary, truth: TopicSummary | None, warnings: list[str]
) -> tuple[NDArray[np.float64] | None, str]:
    """body_T_lidar (4, 4), None where it is unknown, and the comment beside it in the yaml.

    Appends to `warnings`.
    """
    ask = "give x, y, z in m and roll, pitch, yaw in deg"
    if truth is None:
        return np.eye(4), "without poses the LiDAR is the body"
    if not truth.child:
        warnings.append(
            f"{truth.name} does not name the frame that it poses: {ask} of the LiDAR in it as "
            "body_T_lidar"
        )
        return None, f"the posed frame is unknown: {ask}"
    body_T_lidar = (
        np.eye(4) if truth.child == points.frame else contents.tree.fixed(truth.child, points.frame)
    )
    if body_T_lidar is None and points.frame == truth.frame:
        return (
            None,
            f"the points lie in {points.frame} already, the world of the poses: name another topic",
        )
    if body_T_lidar is None:
        warnings.append(
            f"no fixed transforms lead from {truth.child} to {points.frame}: {ask} as body_T_lidar"
        )
        return None, f"no fixed transforms lead from {truth.child} to {points.frame}: {ask}"
    x, y, z = body_T_lidar[:3, 3]
    return (
        body_T_lidar,
        f"fixed transforms put {points.frame} at x {x:.2f}, y {y:.2f}, z {z:.2f} m in "
        f"{truth.child}",
    )


def _lift(
    contents: Contents, points: TopicSummary, body_T_lidar: NDArray[np.float64] | None
) -> tuple[float, str]:
    """The lift in metres that puts the ground at z = 0, and the comment beside it in the yaml.

    It is estimated from the first clouds.
    """
    unknown_lift = (
        0.0,
        "added to z so that the ground is at 0: the height of the posed frame over the ground",
    )
    if points.kind == SWEEP:
        is_raised = (
            body_T_lidar is not None and body_T_lidar[2, 3] > 0.1
        )  # lower ones are invisible in a view of heights
        return (
            0.0 if is_raised else 1.0,
            "a level sweep sees no ground: its height marks occupied bins, so it must not be 0",
        )
    if body_T_lidar is None:
        return unknown_lift
    clouds = (
        cloud @ body_T_lidar[:3, :3].T + body_T_lidar[:3, 3] for cloud in contents.clouds(points)
    )
    heights_m = [
        ground(cloud, np.hypot(cloud[:, 0], cloud[:, 1])) for cloud in clouds if len(cloud) >= 1_000
    ]
    if not heights_m:
        return unknown_lift
    ground_m = float(np.median(heights_m))
    finding = (
        f"the ground lies at z = {ground_m:.2f} m in the posed frame, by {len(heights_m)} of the "
        "first clouds: check it"
    )
    comment = typographic(finding)
    return (0.0 if abs(ground_m) < 0.1 else -round(ground_m, 2)), comment


def _source_line(source: TopicSummary | None) -> str:
    if source is None:
        return "null # this bag holds none"
    parts = [f"in the frame {source.frame or '?'}", f"of {source.child}", _rate(source.rate_hz)]
    known_parts = [
        part
        for part, is_known in zip(parts, (True, source.child, source.rate_hz > 0), strict=True)
        if is_known
    ]
    return f"{_word(source.name)} # {', '.join(known_parts)}"


def _imu_line(imu: TopicSummary | None) -> str:
    if imu is None:
        return "null # of use where there are neither poses nor odometry"
    return f"{_word(imu.name)} # {_rate(imu.rate_hz)}: how the vehicle turned between two scans"


def _word(name: str) -> str:
    """The name of a topic in yaml, quoted where it has to be."""
    return name if re.fullmatch(r"(/|tf:)[\w/>.-]*\w", name, re.ASCII) else json.dumps(name)


def _rate(rate_hz: float) -> str:
    return f"{rate_hz:.3g} a second" if rate_hz > 0 else "at an unknown rate"
