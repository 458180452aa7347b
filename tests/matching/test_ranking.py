"""Rows: a window on a view artifact."""

from pathlib import Path

import numpy as np
import pytest

from pipeline import store
from pipeline.errors import ArtifactError
from pipeline.matching.ranking import Rows
from pipeline.schemas import VIEWS


def test_rows_of_a_view_artifact_are_read_when_sliced(tmp_path: Path) -> None:
    images = np.arange(5 * 2 * 3, dtype=np.float32).reshape(5, 2, 3)
    poses = np.tile(np.eye(4), (5, 1, 1)) * np.arange(5)[:, None, None]
    with store.write(tmp_path / "a.zarr", VIEWS) as draft:
        draft.put("images", images)
        draft.put("stamps_ns", np.arange(5) * 10**9)
        draft.put("world_T_anchor", poses)
    rows = Rows.read(tmp_path / "a.zarr")
    np.testing.assert_array_equal(rows.images[1:3], images[1:3])
    np.testing.assert_array_equal(rows.images[:], images)
    np.testing.assert_array_equal(rows.stamps_ns, np.arange(5) * 10**9)
    np.testing.assert_array_equal(rows.world_T_anchor, poses)


def test_a_view_that_is_not_there_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"b\.zarr: no such artifact"):
        Rows.read(tmp_path / "b.zarr")
