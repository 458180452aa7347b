"""Writes a simulated drive in the files and frames of RobotCar (METHODS 7.2): sweeps of lms_front,
visual odometry, and INS.

Each sequence has a folder of its own, with the extrinsics of RobotCar's SDK inside.
"""

import numpy as np

from pipeline.core.frames import flip_ned, pose
from pipeline.formats import robotcar
from worlds.driving.drive import Drive
from worlds.driving.lidar import CAMERA_HEIGHT_M, Returns, raised
from worlds.driving.odometry import simulate_ins, visual_odometry
from worlds.seeds import Generators, Stream
from worlds.writers.writer import Writer, xyzrpy

LASER = robotcar.LASERS[0]
INS_US = 20_000
"""Microseconds between rows of the INS: 50 a second."""
IMAGES_US = 62_500
"""Microseconds between images: 16 a second."""
INS_OUTAGE = "INS_BAD_GPS_AGREEMENT"
"""Status of the INS in an outage."""
ORIGIN_M = (5_735_000.0, -620_000.0, 110.0)
"""The origin of the simulated world in UTM (x north, y west, z up), in Oxford."""
BODY_T_VEHICLE = raised(CAMERA_HEIGHT_M)
"""(4, 4) the vehicle frame, whose origin is at the camera, on the body."""
VEHICLE_T_INS = pose(*np.hsplit(np.array([robotcar.EXTRINSICS["ins"]]), 2))[0]
"""(4, 4) the INS on the vehicle, with z down in both frames."""


class RobotCarWriter(Writer):
    """Writes one sequence into its folder."""

    def write_ground_truth(self, drive: Drive, reference: Drive, generators: Generators) -> None:
        """Write the extrinsics, the stamps of the sweeps, visual odometry, and the INS's poses."""
        (self.folder / LASER).mkdir(parents=True, exist_ok=True)
        robotcar.write_extrinsics(self.folder / "extrinsics")
        robotcar.write_timestamps(
            self.folder / robotcar.STAMPS.format(laser=LASER), drive.scan_utimes
        )

        image_utimes = np.arange(drive.utimes[0], drive.utimes[-1], IMAGES_US)
        world_T_camera = drive.at(image_utimes) @ BODY_T_VEHICLE
        motion = visual_odometry(generators(Stream.VISUAL_ODOMETRY), world_T_camera)
        robotcar.write_vo(self.folder / robotcar.VO, image_utimes, xyzrpy(flip_ned(motion)))

        ins_utimes = np.arange(drive.utimes[0], drive.utimes[-1], INS_US)
        world_T_vehicle = reference.at(ins_utimes) @ BODY_T_VEHICLE
        reported_T_vehicle, is_good = simulate_ins(generators(Stream.OUTAGES), world_T_vehicle)
        reported_T_vehicle[:, :3, 3] += ORIGIN_M
        statuses = np.where(is_good, robotcar.INS_GOOD, INS_OUTAGE).tolist()
        rows = xyzrpy(flip_ned(reported_T_vehicle) @ VEHICLE_T_INS)
        robotcar.write_ins(self.folder / robotcar.INS, ins_utimes, statuses, rows)

    def write_scan(self, scan: int, utime: int, returns: Returns) -> None:
        """Write lms_front/<utime>.bin."""
        data = robotcar.encode_sweep(returns.points_m[:, :2], returns.intensity)
        (self.folder / LASER / f"{utime}.bin").write_bytes(data)
