"""What the data sets call their sequences, and when those were driven."""

import re
from datetime import UTC, date, datetime

from pipeline.errors import ConfigError

KITTI_DATE = date(2011, 9, 26)
"""A log's number tells no date: all are driven on the day of KITTI's first."""


def nclt_date(sequence: str) -> date:
    """NCLT's name is a date, such as 2012-01-15."""
    try:
        return date.fromisoformat(sequence)
    except (TypeError, ValueError):
        raise ConfigError(f"sequence {sequence}: expected a date such as '2012-01-15'") from None


def robotcar_time(sequence: str) -> datetime:
    """RobotCar's name is a date and a time, such as 2014-07-14-14-49-50."""
    try:
        return datetime.strptime(sequence, "%Y-%m-%d-%H-%M-%S").replace(tzinfo=UTC)
    except (TypeError, ValueError):
        raise ConfigError(f"sequence {sequence}: expected a date and time such as '2014-07-14-14-49-50'") from None


def kitti_date(sequence: str) -> date:
    """KITTI's name is a log's number of two digits, such as 00."""
    if kitti_log(sequence) != sequence:
        raise ConfigError(f"sequence {sequence}: is a part; the table names whole logs, such as '{kitti_log(sequence)}'")
    return KITTI_DATE


def kitti_log(sequence: str) -> str:
    """The log that a sequence, such as 00, 00-a or 00-b, is of."""
    named = re.fullmatch(r"(\d\d)(-[ab])?", str(sequence))
    if not named:
        raise ConfigError(f"sequence {sequence}: expected a log's two digits such as '00', or its part '00-a' or '00-b'")
    return named[1]
