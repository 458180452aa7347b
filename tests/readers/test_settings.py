"""Tests the settings of the readers: those that are refused, and those of the project's yamls."""

from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import yaml

from pipeline.core.errors import ConfigError
from pipeline.readers.bag import Bag
from pipeline.readers.carmen import Carmen
from pipeline.readers.folder import Folder
from pipeline.readers.keyframes import KeyFrames
from pipeline.readers.robotcar import RobotCar
from tests.readers.damage import one_line

CONF = Path(__file__).parents[2] / "conf" / "dataset"


@pytest.mark.parametrize("reader", [Bag, Carmen, Folder, RobotCar])
def test_the_yaml_holds_the_fields_of_the_reader_and_their_defaults(reader: type) -> None:
    settings = yaml.safe_load((CONF / f"{reader.__name__.lower()}.yaml").read_text())["reader"]
    assert settings.pop("_target_") == f"{reader.__module__}.{reader.__name__}"
    assert {
        key: tuple(value) if isinstance(value, list) else value for key, value in settings.items()
    } == asdict(reader())


@pytest.mark.parametrize(
    ("reader", "settings", "says"),
    [
        (Bag, {"max_gap_s": 0}, "reader.max_gap_s=0"),
        (Bag, {"lift_m": "high"}, "reader.lift_m=high"),
        (Bag, {"odometry": 3}, "reader.odometry=3"),
        (Bag, {"ground_truth": "tf:map"}, "reader.ground_truth=tf:map: expected tf:PARENT>CHILD"),
        (Bag, {"body_T_lidar": [1, 2, 3]}, "reader.body_T_lidar"),
        (Carmen, {"lasers": ["left"]}, r"lasers\[0\]=left: expected front or rear"),
        (Carmen, {"corrected": "{sequence}.relations"}, "log; .relations hold no poses"),
        (Carmen, {"corrected": "../{sequence}.log"}, "expected the name"),
        (Carmen, {"sweep_s": 0}, "sweep_s=0"),
        (
            KeyFrames,
            {"ground_truth": "odometry"},
            "=odometry: expected rtk, optimised_1 or optimised_2",
        ),
        (Folder, {"point_bytes": 8}, "point_bytes=8: expected 12 or more"),
        (Folder, {"point_bytes": 16.5}, "point_bytes=16.5: expected a whole number"),
        (Folder, {"stamps": "ms"}, "stamps=ms: expected s, us or ns"),
        (Folder, {"max_gap_s": 0}, "max_gap_s=0: expected a number above 0"),
        (
            Folder,
            {"body_T_lidar": [0, 0, 0]},
            r"body_T_lidar=\[0, 0, 0\]: expected \[x, y, z, roll, pitch, yaw\]",
        ),
        (Folder, {"body_T_lidar": [0, 0, 0, 0, 0, float("nan")]}, "body_T_lidar"),
        (Folder, {"body_T_lidar": None}, "body_T_lidar=None"),
        (Folder, {"body_T_lidar": "000000"}, "body_T_lidar=000000"),
        (Folder, {"scans": "../other"}, "=../other: expected a path below the sequence's folder"),
        (Folder, {"scans": "/data/*.pcd"}, "expected a path below"),
        (Folder, {"scans": "**/*.pcd"}, "expected a path below"),
        (Folder, {"poses": ""}, "poses=: expected a path below"),
        (Folder, {"odometry": 3}, "odometry=3: expected a word or null"),
        (RobotCar, {"lasers": []}, "reader.lasers"),
        (RobotCar, {"lasers": "lms_front"}, "reader.lasers"),
        (RobotCar, {"lasers": ["lms_top"]}, "reader.lasers"),
        (RobotCar, {"lasers": ["lms_front", "lms_front"]}, "reader.lasers"),
        (RobotCar, {"lasers": 5}, "reader.lasers"),
        (RobotCar, {"max_vo_gap_s": 0}, "reader.max_vo_gap_s"),
        (RobotCar, {"max_ins_gap_s": -1.0}, "reader.max_ins_gap_s"),
        (RobotCar, {"extrinsics": 3}, "reader.extrinsics"),
    ],
)
def test_the_error_on_a_wrong_setting_names_it(
    reader: type, settings: dict[str, Any], says: str
) -> None:
    with one_line(ConfigError, says):
        reader(**settings)
