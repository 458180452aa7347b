"""The dates in names of sequences, and the names that are refused."""

from datetime import UTC, date, datetime

import pytest

from tests.worlds.helpers import refused
from worlds.names import kitti_date, kitti_log, nclt_date, robotcar_time


def test_names_give_the_time_of_a_drive():
    assert nclt_date("2012-01-15") == date(2012, 1, 15)
    assert robotcar_time("2014-07-14-14-49-50") == datetime(2014, 7, 14, 14, 49, 50, tzinfo=UTC)
    assert kitti_date("07") == kitti_date("00")
    assert [kitti_log(name) for name in ("07", "07-a", "07-b")] == ["07"] * 3


@pytest.mark.parametrize(
    ("when", "name"),
    [
        *((nclt_date, name) for name in ("summer", "2014-07-14-14-49-50", "2012-13-01", 2012)),
        *(
            (robotcar_time, name)
            for name in ("2014-07-14", "2014-07-14-24-49-50", "2014-07-14-14-49-50-", None)
        ),
        *((kitti_date, name) for name in ("0", "000", "00-a", "2012-01-15", 0)),
        *((kitti_log, name) for name in ("00-c", "00-", "-a", "00-a-b")),
    ],
)
def test_another_name_is_one_line_of_error(when, name):
    with refused("sequence"):
        when(name)
