"""Tests of the benchmark that compares our poses with those of other software
(benchmarks/closures.py)."""

import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest


@pytest.fixture
def closures(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")  # the module sets it for good
    from benchmarks import closures

    return closures


def answers(closures, x_m: list[float], accepted: list[bool], seen: list[bool]):
    """The answers of a peer to queries that are all at the origin."""
    result = np.tile(np.eye(4), (len(x_m), 1, 1))
    result[:, 0, 3] = x_m
    true = np.tile(np.eye(4), (len(x_m), 1, 1))
    return closures.Answers(
        result, true, np.array(accepted), np.array(seen), np.array([10.0, 20.0, 30.0, 90.0])
    )


def test_a_peer_that_is_not_there_is_left_out_with_a_line(closures, monkeypatch, tmp_path):
    for name in ("yearloc", "from_ranking", "registered"):
        monkeypatch.setattr(
            closures, name, lambda *_: answers(closures, [0.0] * 4, [True] * 4, [True] * 4)
        )
    monkeypatch.setattr(closures, "of_walls", lambda *_: None)
    monkeypatch.setitem(sys.modules, "kiss_matcher", None)  # import fails
    _, _, ours, *further_lines = closures.table(
        SimpleNamespace(scan_context=tmp_path / "scan_context"), Path(tmp_path)
    )
    assert ours.split()[0] == "yearloc"
    left_out = [line for line in further_lines if "left out" in line]
    assert [line.split(" left out")[0].strip() for line in left_out] == [
        "MapClosures",
        "GICP",
        "KISS-Matcher",
    ]


def test_a_row_counts_right_seen_queries_and_wrong_accepted_poses(closures):
    """At 0, 1.9, 2.1 m and nowhere: two of the three seen are right, one is kept; of the last
    three, accepted, two are wrong."""
    row = answers(
        closures, [0.0, 1.9, 2.1, np.nan], [False, True, True, True], [True, True, True, False]
    ).line("peer")
    assert row.split() == ["peer", "4", "3", "0.667", "0.333", "3", "2", "2", "20", "25"]


def test_from_above_height_does_not_count(closures):
    """All are 3 m too high, the last is 3 m aside too."""
    result = answers(closures, [0.0, 0.0, 0.0, 3.0], [True] * 4, [True] * 4)
    result.world_T_query[:, 2, 3] = 3.0
    assert result.line("peer").split()[5:8] == ["4", "4", "1"]
