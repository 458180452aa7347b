"""The names of sequences in the real data sets, and the dates that they stand for."""

import re
from datetime import UTC, date, datetime

from pipeline.core.errors import ConfigError

KITTI_DATE = date(2011, 9, 26)
"""The date of all KITTI logs. Their numbers are no dates, so it is that of the first log."""


def nclt_date(sequence: str) -> date:
    """The date in a name of NCLT, such as 2012-01-15; raises ConfigError for any other name."""
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
    """The date of a KITTI log by its two digits, such as 00; raises ConfigError for others."""
    if kitti_log(sequence) != sequence:
        raise ConfigError(
            f"sequence {sequence}: is a split; the table names whole logs, such as "
            f"'{kitti_log(sequence)}'"
        )
    return KITTI_DATE


def kitti_log(sequence: str) -> str:
    """The log of a sequence such as 00, 00-a or 00-b; raises ConfigError for any other name."""
    match = re.fullmatch(r"(\d\d)(-[ab])?", str(sequence))
    if not match:
        raise ConfigError(
            f"sequence {sequence}: expected a log's two digits such as '00', or its split "
            "'00-a' or '00-b'"
        )
    return match[1]
