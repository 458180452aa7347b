"""The motion of the robots along their planned routes."""

from dataclasses import dataclass

KNOTS_HZ = 10


@dataclass(frozen=True)
class Motion:
    """The parameters of a robot's path and of its rocking (sd: standard deviation)."""

    speed_mps: float
    corner_m: float
    """Corners are rounded over this length."""
    keep_right_m: float
    bias_sd_m: float
    """Lateral offset of a whole drive; `weave_sd_m` is the deviation about it."""
    weave_sd_m: float
    roll_sd_deg: float
    pitch_sd_deg: float
    heading_sd_deg: float
    wheelbase_m: float
    """Length over which it follows the slope of the ground; 0: it balances upright."""
    keep_off_m: float
    """People and cars do not come nearer than this to its centre."""
    pilot: bool
    """Whether a person walks behind it."""

    @property
    def knot_m(self) -> float:
        """Distance between two poses of the truth."""
        return self.speed_mps / KNOTS_HZ


SEGWAY = Motion(1.3, 7.0, 0.8, 0.5, 0.8, 1.2, 1.8, 3.0, wheelbase_m=0.0, keep_off_m=0.3, pilot=True)
CAR = Motion(8.0, 9.0, 1.7, 0.15, 0.25, 0.4, 0.5, 0.5, wheelbase_m=2.7, keep_off_m=2.5, pilot=False)
