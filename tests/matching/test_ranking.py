"""Rows, a window on a view artifact of one or several cases; and rankings of wrong shapes."""

from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.core import store
from pipeline.core.errors import ArtifactError, InputError
from pipeline.core.schemas import ScanContextViews
from pipeline.matching.ranking import Ranking, Rows, joined
from pipeline.perturbations import Case

IMAGES = np.arange(6 * 2 * 3, dtype=np.float32).reshape(6, 2, 3)
POSES = np.tile(np.eye(4), (6, 1, 1)) * np.arange(6)[:, None, None]
STAMPS_NS = np.arange(6) * 10**9


def view(path: Path, cases: Sequence[Case] = (Case(),)) -> Path:
    """Write an artifact of six rows, which the cases share equally; returns its path."""
    with store.draft(path, ScanContextViews, cases=[asdict(case) for case in cases]) as draft:
        draft.put("images", IMAGES)
        draft.put("stamps_ns", STAMPS_NS)
        draft.put("world_T_anchor", POSES)
    return path


def test_rows_of_a_view_artifact_are_read_when_sliced(tmp_path: Path) -> None:
    rows = Rows.read(view(tmp_path / "a.zarr"))
    assert not isinstance(rows.images, np.ndarray)
    np.testing.assert_array_equal(rows.images[1:3], IMAGES[1:3])
    np.testing.assert_array_equal(rows.images[:], IMAGES)
    np.testing.assert_array_equal(rows.stamps_ns, STAMPS_NS)
    np.testing.assert_array_equal(rows.world_T_anchor, POSES)


def test_each_case_has_its_own_rows_of_all_submaps(tmp_path: Path) -> None:
    # two submaps in three cases: rows 0 and 1, 2 and 3, 4 and 5
    cases = (Case("turned"), Case("turned", repeat=1), Case("construction", 2.0, shadow=True))
    found = Rows.cases(view(tmp_path / "a.zarr", cases))
    assert tuple(found) == cases
    for i, rows in enumerate(found.values()):
        np.testing.assert_array_equal(rows.images, IMAGES[2 * i : 2 * i + 2])
        assert rows.stamps_ns.tolist() == [2 * i * 10**9, (2 * i + 1) * 10**9]
        np.testing.assert_array_equal(rows.world_T_anchor, POSES[2 * i : 2 * i + 2])


def test_the_only_case_is_the_whole_artifact(tmp_path: Path) -> None:
    ((case, rows),) = Rows.cases(view(tmp_path / "a.zarr", [Case("demolition", 60.0)])).items()
    assert case == Case("demolition", 60.0)
    np.testing.assert_array_equal(rows.images[:], IMAGES)


def test_rows_of_several_sequences_follow_one_another(tmp_path: Path) -> None:
    one = Rows.read(view(tmp_path / "a.zarr"))
    assert Rows.joined([one]) is one
    both = Rows.joined([one, Rows(IMAGES[:1] + 99, STAMPS_NS[:1] + 7, POSES[:1])])
    assert both.images[:, 0, 0].tolist() == [0, 6, 12, 18, 24, 30, 99]
    assert both.stamps_ns.tolist() == [*STAMPS_NS, 7]
    assert both.world_T_anchor.shape == (7, 4, 4)


def test_rankings_of_several_cases_follow_one_another() -> None:
    first, second = (Ranking(*[np.full((2, 1), value)] * 6, ("own",)) for value in (1, 2))  # type: ignore[arg-type]
    both = joined([first, second])
    assert all(
        getattr(both, name).tolist() == [[1], [1], [2], [2]]
        for name in vars(both)
        if name != "kinds"
    )
    assert both.kinds == ("own",)


def test_a_view_that_is_not_there_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(ArtifactError, match=r"b\.zarr: no such artifact"):
        Rows.read(tmp_path / "b.zarr")


RANKING = Ranking(
    *(
        np.zeros((4, 3), np.int64),
        np.zeros((4, 3), np.float32),
        np.zeros((4, 3, 2)),
        np.zeros((4, 1), np.float32),
    ),
    *(np.zeros(4, np.float32), np.zeros((4, 3), np.float32), ("distance",)),
)


@pytest.mark.parametrize(
    ("wrong", "line"),
    [
        ({"places": np.zeros((3, 3), np.int64)}, r"places of shape \(3, 3\): expected \(4, 3\)"),
        (
            {"heading_deg": np.zeros((4, 1), np.float32)},
            r"heading_deg of shape \(4, 1\): expected \(4, 3\)",
        ),
        ({"kinds": ("a", "b")}, r"novelty of shape \(4, 1\): expected \(4, 2\)"),
        (
            {"novelty": np.array([[0], [np.nan], [0], [np.nan]], np.float32)},
            "NaN for 2 of 4 queries",
        ),
    ],
)
def test_answers_of_a_wrong_shape_or_without_novelty_are_refused(wrong: dict, line: str) -> None:
    assert RANKING.checked(4) is RANKING
    with pytest.raises(InputError, match=line):
        replace(RANKING, **wrong).checked(4)
