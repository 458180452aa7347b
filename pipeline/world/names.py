"""The names of the sequences of each data set, and the dates in them."""

import re
from datetime import UTC, date, datetime

from pipeline.core.errors import ConfigError

KITTI_DATE = date(2011, 9, 26)
"""The date of all logs, that of the first KITTI log, since the number of a log is not a date."""


def nclt_date(sequence: str) -> date:
    """The date in a name of NCLT, such as 2012-01-15; raises ConfigError."""
    try:
        return date.fromisoformat(sequence)
    except (TypeError, ValueError):
        raise ConfigError(f"sequence {sequence}: expected a date such as '2012-01-15'") from None


def robotcar_time(sequence: str) -> datetime:
    """The UTC time in a name of RobotCar, such as 2014-07-14-14-49-50; raises ConfigError."""
    try:
        return datetime.strptime(sequence, "%Y-%m-%d-%H-%M-%S").replace(tzinfo=UTC)
    except (TypeError, ValueError):
        raise ConfigError(
            f"sequence {sequence}: expected a date and time such as '2014-07-14-14-49-50'"
        ) from None


def kitti_date(sequence: str) -> date:
    """The date of a KITTI log named by its two digits, such as 00; raises ConfigError."""
    if kitti_log(sequence) != sequence:
        raise ConfigError(
            f"sequence {sequence}: is a part; the table names whole logs, such as "
            f"'{kitti_log(sequence)}'"
        )
    return KITTI_DATE


def kitti_log(sequence: str) -> str:
    """The log of a sequence such as 00, 00-a or 00-b; raises ConfigError."""
    named = re.fullmatch(r"(\d\d)(-[ab])?", str(sequence))
    if not named:
        raise ConfigError(
            f"sequence {sequence}: expected a log's two digits such as '00', or its part '00-a' or "
            "'00-b'"
        )
    return named[1]
