"""Writes the layout and frames of RobotCar: sweeps of lms_front, visual odometry and INS (METHODS
7.2).

Each sequence has a folder of its own, with the extrinsics of the SDK inside.
"""

import numpy as np

from pipeline.core.frames import flip_ned, pose
from pipeline.formats import robotcar
from pipeline.world.driving.drive import Drive
from pipeline.world.driving.lidar import CAMERA_HEIGHT_M, Returns, raised
from pipeline.world.driving.odometry import simulate_ins, visual_odometry
from pipeline.world.seeds import Generators, Stream
from pipeline.world.writers.writer import Writer, xyzrpy

LASER = robotcar.LASERS[0]
INS_US = 20_000
IMAGES_US = 62_500
"""50 rows and 16 images a second."""
BLIND = "INS_BAD_GPS_AGREEMENT"
ORIGIN_M = (5_735_000.0, -620_000.0, 110.0)
"""The origin of the simulated world in UTM (x north, y west, z up), in Oxford."""
BODY_T_VEHICLE = raised(CAMERA_HEIGHT_M)
VEHICLE_T_INS = pose(*np.hsplit(np.array([robotcar.EXTRINSICS["ins"]]), 2))[0]
"""(4, 4) in the z-down vehicle frame."""


class RobotCarWriter(Writer):
    """Writes one sequence into its folder."""

    def write_truth(self, drive: Drive, surveyed: Drive, generators: Generators) -> None:
        """Write the extrinsics, the stamps of the sweeps, the visual odometry, and the INS with its
        outages."""
        (self.folder / LASER).mkdir(parents=True, exist_ok=True)
        robotcar.write_extrinsics(self.folder / "extrinsics")
        robotcar.write_timestamps(
            self.folder / robotcar.STAMPS.format(laser=LASER), drive.scan_utimes
        )
        images, rows = (
            np.arange(drive.utimes[0], drive.utimes[-1], step_us) for step_us in (IMAGES_US, INS_US)
        )
        motion = visual_odometry(
            generators(Stream.VISUAL_ODOMETRY), drive.at(images) @ BODY_T_VEHICLE
        )
        robotcar.write_vo(self.folder / robotcar.VO, images, xyzrpy(flip_ned(motion)))
        reported, good = simulate_ins(
            generators(Stream.OUTAGES), surveyed.at(rows) @ BODY_T_VEHICLE
        )
        reported[:, :3, 3] += ORIGIN_M
        statuses = np.where(good, robotcar.INS_GOOD, BLIND).tolist()
        robotcar.write_ins(
            self.folder / robotcar.INS, rows, statuses, xyzrpy(flip_ned(reported) @ VEHICLE_T_INS)
        )

    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """lms_front/<utime>.bin."""
        data = robotcar.encode_sweep(returns.points_m[:, :2], returns.intensity)
        (self.folder / LASER / f"{utime}.bin").write_bytes(data)
