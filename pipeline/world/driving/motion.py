"""How the robots move along their plans."""

from dataclasses import dataclass

KNOTS_HZ = 10


@dataclass(frozen=True)
class Motion:
    """What a drive makes of a line on the map."""

    speed_mps: float
    corner_m: float
    """Corners are rounded over this length."""
    keep_right_m: float
    bias_sd_m: float
    """Of a whole drive's line; `weave_sd_m` is about it."""
    weave_sd_m: float
    roll_sd_deg: float
    pitch_sd_deg: float
    heading_sd_deg: float
    wheelbase_m: float
    """It stands on the ground's slope over this length; 0: it balances upright."""
    keep_off_m: float
    """Nobody comes nearer to its middle."""
    pilot: bool
    """Whether somebody walks behind it."""

    @property
    def knot_m(self) -> float:
        """How far it comes between two poses of the truth."""
        return self.speed_mps / KNOTS_HZ


SEGWAY = Motion(1.3, 7.0, 0.8, 0.5, 0.8, 1.2, 1.8, 3.0, wheelbase_m=0.0, keep_off_m=0.3, pilot=True)
CAR = Motion(8.0, 9.0, 1.7, 0.15, 0.25, 0.4, 0.5, 0.5, wheelbase_m=2.7, keep_off_m=2.5, pilot=False)
