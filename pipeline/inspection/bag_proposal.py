"""Proposes the yaml of a data set of bags: the contents of bags in; the text of a yaml out.

The yaml names the topics and frames for the reader `Bag`, each with a comment that says why. What
a topic or frame holds is guessed from its type and name, where the LiDAR sits from the transforms,
and how high from the ground in its clouds.
"""

import json
import re

import numpy as np
from numpy.typing import NDArray

from pipeline.core.frames import transformed
from pipeline.formats.bag import SWEEP
from pipeline.formats.bag_file import plain
from pipeline.inspection.inspection import typographic
from pipeline.mapping.appearance import measure_ground_m
from pipeline.opening.bag_contents import (
    DRIFTING_NAMES,
    Contents,
    TopicSummary,
    gyroscope,
    points_source,
    pose_sources,
)

MIN_CLOUD_POINTS = 1_000
"""The ground is not looked for in smaller clouds."""


def propose(contents: Contents) -> tuple[str, list[str]]:
    """The text of a file for conf/dataset, and warnings for its user.

    The text names points, ground truth, odometry and extrinsics. Raises LogError for bags without
    points.
    """
    best_poses, odometry = pose_sources(contents)
    points = points_source(contents, best_poses)
    is_sweep = points.kind == SWEEP
    warnings: list[str] = []
    # the best poses are the ground truth, unless they drift; sweeps also need them as odometry
    ground_truth = best_poses
    if best_poses is None:
        warnings.append(_without_poses(contents, is_sweep))
    else:
        drifts = bool(DRIFTING_NAMES.search(best_poses.frame))
        if drifts:
            warnings.append(_with_odometry_alone(best_poses, is_sweep))
        if odometry is None and (is_sweep or drifts):
            odometry = best_poses
            if not is_sweep:
                ground_truth = None
    body_T_lidar, extrinsic = _extrinsic(contents, points, best_poses, warnings)
    lift_m, lift = _lift(contents, points, body_T_lidar)
    imu = None if ground_truth or odometry else gyroscope(contents)
    gap_s = 0.5
    if best_poses and best_poses.rate_hz > 0:
        gap_s = max(gap_s, round(3 / best_poses.rate_hz, 1))  # two lost messages are no gap
    shape = "LaserScan: a row is one sweep" if is_sweep else "PointCloud2"
    name = contents.files[0].path.name
    frame = points.frame or "?"
    text = f"""\
# Proposed by `yearloc inspect` from {name}; conf/dataset/bag.yaml explains the keys.
simulated: false
reader:
  _target_: pipeline.readers.bag.Bag
  points: {_word(points.name)} # {shape}, {_rate(points.rate_hz)}, in the frame {frame}
  ground_truth: {_source_line(ground_truth)}
  odometry: {_source_line(odometry)}
  imu: {_imu_line(imu)}
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
    first_line, following_lines = text.split("\n", 1)
    comments = [f"# Beware: {warning}" for warning in warnings]
    return "\n".join([first_line, *comments, following_lines]), warnings


def _without_poses(contents: Contents, is_sweep: bool) -> str:
    """The warning on bags without any source of poses."""
    topic_list = ", ".join(
        f"{topic.name} ({topic.kind.replace('/msg/', '/')})" for topic in contents.topics
    )
    advice = (
        "`yearloc use NAME root=FOLDER train=DRIVE poses=slam` estimates them, `yearloc slam` of "
        "one drive alone"
    )
    if is_sweep:
        advice = (
            "sweeps of a 2-D LiDAR need an Odometry, PoseStamped, PoseWithCovarianceStamped, or "
            "moving transforms in tf beside them"
        )
    return f"no poses: {advice}. Topics here: {plain(topic_list, 600)}"


def _with_odometry_alone(poses: TopicSummary, is_sweep: bool) -> str:
    """The warning on bags whose best source of poses drifts."""
    drift = f"the only poses are in the frame {poses.frame}, which starts again with each drive"
    if is_sweep:
        return (
            f"{drift}: sequences share no places; a study over several drives needs poses in one "
            "frame, such as map"
        )
    return (
        f"{drift}: they are the odometry; `yearloc use NAME root=FOLDER train=DRIVE poses=slam` "
        "estimates poses in one frame from the scans. To split a single drive, "
        f"{poses.name} may be named as ground_truth"
    )


def _extrinsic(
    contents: Contents, points: TopicSummary, poses: TopicSummary | None, warnings: list[str]
) -> tuple[NDArray[np.float64] | None, str]:
    """body_T_lidar (4, 4), None where it is unknown, and the comment beside it in the yaml."""
    ask = "give x, y, z in m and roll, pitch, yaw in deg"
    if poses is None:
        return np.eye(4), "without poses the LiDAR is the body"
    body = poses.child
    if not body:
        warnings.append(
            f"{poses.name} does not name the frame that it poses: {ask} of the LiDAR in it as "
            "body_T_lidar"
        )
        return None, f"the posed frame is unknown: {ask}"
    body_T_lidar = contents.transforms.body_T_lidar([body], {points.frame})
    if body_T_lidar is None and points.frame == poses.frame:
        return (
            None,
            f"the points lie in {points.frame} already, the world of the poses: name another topic",
        )
    if body_T_lidar is None:
        warnings.append(
            f"no fixed transforms lead from {body} to {points.frame}: {ask} as body_T_lidar"
        )
        return None, f"no fixed transforms lead from {body} to {points.frame}: {ask}"
    x, y, z = body_T_lidar[:3, 3]
    return (
        body_T_lidar,
        f"fixed transforms put {points.frame} at x {x:.2f}, y {y:.2f}, z {z:.2f} m in {body}",
    )


def _lift(
    contents: Contents, points: TopicSummary, body_T_lidar: NDArray[np.float64] | None
) -> tuple[float, str]:
    """The lift in metres that puts the ground at z = 0, and the comment beside it in the yaml."""
    if points.kind == SWEEP:
        # a sweep at 0.1 m or lower would be invisible in a view of heights
        is_raised = body_T_lidar is not None and body_T_lidar[2, 3] > 0.1
        return (
            0.0 if is_raised else 1.0,
            "a level sweep sees no ground: its height marks occupied bins, so it must not be 0",
        )
    heights_m: list[float] = []
    if body_T_lidar is not None:
        for cloud in contents.clouds(points):
            body_cloud = transformed(body_T_lidar, cloud)
            if len(cloud) >= MIN_CLOUD_POINTS:
                range_m = np.hypot(body_cloud[:, 0], body_cloud[:, 1])
                heights_m.append(measure_ground_m(body_cloud, range_m))
    if not heights_m:
        return (
            0.0,
            "added to z so that the ground is at 0: the height of the posed frame over the ground",
        )
    ground_m = float(np.median(heights_m))
    finding = (
        f"the ground lies at z = {ground_m:.2f} m in the posed frame, by {len(heights_m)} of the "
        "first clouds: check it"
    )
    # within 0.1 m the estimate may be wrong, and the posed frame rather is on the ground
    lift_m = 0.0 if abs(ground_m) < 0.1 else -round(ground_m, 2)
    return lift_m, typographic(finding)


def _source_line(source: TopicSummary | None) -> str:
    """A source of poses as a value in the yaml, with a comment."""
    if source is None:
        return "null # this bag holds none"
    parts = [f"in the frame {source.frame or '?'}"]
    if source.child:
        parts.append(f"of {source.child}")
    if source.rate_hz > 0:
        parts.append(_rate(source.rate_hz))
    return f"{_word(source.name)} # {', '.join(parts)}"


def _imu_line(imu: TopicSummary | None) -> str:
    """The topic of an IMU as a value in the yaml, with a comment."""
    if imu is None:
        return "null # of use where there are neither poses nor odometry"
    return f"{_word(imu.name)} # {_rate(imu.rate_hz)}: how the vehicle turned between two scans"


def _word(name: str) -> str:
    """The name of a topic in yaml, quoted where it has to be."""
    return name if re.fullmatch(r"(/|tf:)[\w/>.-]*\w", name, re.ASCII) else json.dumps(name)


def _rate(rate_hz: float) -> str:
    return f"{rate_hz:.3g} a second" if rate_hz > 0 else "at an unknown rate"
