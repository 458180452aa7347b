"""Tests of the timing of queries: what is timed, on which submaps, the rows of the results, and the
stage `latency` on the smallest artifacts."""

import json
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from omegaconf import OmegaConf

from pipeline.core import store
from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError, InputError
from pipeline.core.progress import Progress
from pipeline.evaluation import timing
from pipeline.evaluation.rows import COLUMNS
from pipeline.evaluation.timing import (
    WARM_UP,
    Latency,
    TimedMethod,
    clouds,
    cost_rows,
    machine_record,
    processor,
)
from pipeline.matching.ranking import Ranking, Rows
from pipeline.methods.m2dp import M2dp
from pipeline.running.telemetry import Trace
from pipeline.studies.models import ModelName
from pipeline.views.draw import Drawing
from tests.artifacts import write_scans, write_submaps
from tests.evaluation.made import standing

BY_HAND = Latency(
    generation={"wide": np.array([1.0, 2.0, 3.0]), "narrow": np.array([10.0, 10.0, 40.0])},
    retrieval={
        "a": np.array([4.0, 1.0, 1.0]),
        "b": np.array([0.5, 0.5, 0.5]),
        "c": np.array([7.0, 8.0, 9.0]),
    },
    views={"a": "wide", "b": "narrow", "c": "wide"},
    points=np.array([100, 300, 5_000]),
    k=25,
    machine={"processor": "Abacus"},
)


PARTS = [f"{part}_ms{end}" for part in ("generation", "retrieval", "query") for end in ("", "_p95")]


def drive(
    folder: Path, sequence: str, submaps: int, sweeps: int = 1
) -> tuple[store.Artifact, store.Artifact]:
    """Scans two metres apart along x, and submaps of one or more; scan i has 200 + i points."""
    scans = submaps + sweeps - 1
    lengths = 200 + np.arange(submaps + sweeps - 1)
    points_m = np.random.default_rng(1).normal(0, (9, 5, 2), (lengths.sum(), 3))
    last = np.arange(sweeps - 1, scans)
    poses = standing(np.c_[2.0 * np.arange(scans), np.zeros(scans)])
    clouds = np.split(points_m, np.cumsum(lengths)[:-1])[:scans]
    return (
        write_scans(
            folder / f"scans/campus/{sequence}.zarr",
            clouds,
            poses,
            stamps_ns=10 * np.arange(scans),
        ),
        write_submaps(
            folder / f"submaps/campus/{sequence}.zarr",
            poses[last],
            stamps_ns=10 * last,
            first=last - (sweeps - 1),
            scans=last,
            ground_m=np.full(len(last), 0.25),
            used=np.ones(scans, bool),
            layout="odom_T_scan",
        ),
    )


class Clock:
    """A clock for wall time and CPU time that advances only on call."""

    def __init__(self) -> None:
        self.wall_s = 0.0
        self.cpu_s = 0.0

    def work(self, seconds: float) -> None:
        """Let time pass, a quarter of it on a core."""
        self.wall_s += seconds
        self.cpu_s += seconds / 4

    def perf_counter(self) -> float:
        return self.wall_s

    def process_time(self) -> float:
        return self.cpu_s


class Recorder:
    """A view and a method that take their time and remember what they were given."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.drawn: list[int] = []
        self.asked: list[Rows] = []

    def draw(self, points: np.ndarray) -> np.ndarray:
        self.drawn.append(len(points))
        self.clock.work(0.004)
        return np.array([len(points)], np.float32)

    def localize(self, work_s: float) -> Callable[[Rows, int], Ranking]:
        def localize(views: Rows, k: int) -> Ranking:
            assert k == 7
            self.asked.append(views)
            self.clock.work(work_s)
            return Ranking(*[np.zeros((1, k))] * 6, ("own",))  # type: ignore[arg-type]

        return localize


@pytest.fixture
def recorder(monkeypatch: pytest.MonkeyPatch) -> Recorder:
    """A recorder whose clock is the one that latencies are measured by."""
    clock = Clock()
    monkeypatch.setattr(timing, "time", clock)
    return Recorder(clock)


@pytest.fixture
def measured(recorder: Recorder, tmp_path: Path) -> Latency:
    """Two methods of one view on five of nine submaps."""
    one, two = (
        TimedMethod("view", recorder.draw, recorder.localize(work_s)) for work_s in (0.002, 0.008)
    )
    return Latency.measure({"one": one, "two": two}, *drive(tmp_path, "a", 9), queries=5, k=7)


def test_each_part_takes_its_own_time(measured: Latency) -> None:
    np.testing.assert_allclose(measured.generation["view"], 4.0)
    np.testing.assert_allclose(measured.retrieval["one"], 2.0)
    np.testing.assert_allclose(measured.retrieval["two"], 8.0)
    np.testing.assert_allclose(measured.total["two"], 12.0)
    assert measured.machine["busy"] == 0.25


def test_a_network_that_makes_a_descriptor_is_generation(
    recorder: Recorder, tmp_path: Path
) -> None:
    """The network's time counts as generation, as for PointNetVLAD in the SCI paper's Table III."""
    asked = TimedMethod(
        "view", recorder.draw, recorder.localize(0.012), lambda _: recorder.clock.work(0.008)
    )
    split = Latency.measure({"one": asked}, *drive(tmp_path, "a", 5), queries=3, k=7)
    rows = {row["number"]: row["value"] for row in split.rows()}
    assert rows["generation_ms"] == pytest.approx(4 + 8)
    assert rows["retrieval_ms"] == pytest.approx(12 - 8)
    assert rows["query_ms"] == pytest.approx(4 + 12)
    np.testing.assert_allclose(split.total["one"], 16.0)


def test_queries_are_spread_over_the_sequence_and_the_first_calls_do_not_count(
    measured: Latency, recorder: Recorder
) -> None:
    # Rows 0, 2, 4, 6 and 8 of nine; submap i has 200 + i points. A view that two methods look at is
    # drawn once.
    assert measured.points.tolist() == [200, 202, 204, 206, 208]
    assert recorder.drawn == [200] * WARM_UP + [200, 202, 204, 206, 208]
    assert all(
        len(took) == 5
        for took in (
            *measured.generation.values(),
            *measured.retrieval.values(),
            *measured.total.values(),
        )
    )


def test_a_method_is_asked_with_one_query_and_that_querys_stamp_and_pose(
    measured: Latency, recorder: Recorder
) -> None:
    assert len(recorder.asked) == 2 * (WARM_UP + 5)
    last = recorder.asked[-1]
    assert np.asarray(last.images).tolist() == [[208]]
    assert last.stamps_ns.tolist() == [80]
    assert last.world_T_anchor[:, 0, 3].tolist() == [16]


def test_there_are_no_more_queries_than_submaps_and_nothing_to_measure_is_an_error(
    recorder: Recorder, tmp_path: Path
) -> None:
    one = {"one": TimedMethod("view", recorder.draw, recorder.localize(0))}
    assert len(Latency.measure(one, *drive(tmp_path, "a", 3), queries=50, k=7).points) == 3
    with pytest.raises(InputError, match="no submap"):
        Latency.measure(one, *drive(tmp_path, "b", 0), queries=5, k=7)
    with pytest.raises(ConfigError, match=r"latency\.queries=0"):
        Latency.measure(one, *drive(tmp_path, "c", 2), queries=0, k=7)


@pytest.mark.parametrize("sweeps", [1, 3])
def test_points_are_those_that_views_are_drawn_from(sweeps: int, tmp_path: Path) -> None:
    scans, submaps = drive(tmp_path, "a", 8, sweeps)
    drawn = np.concatenate(
        list(Drawing(scans, submaps, lambda points: points.sum(axis=0)).blocks(Compute(workers=1)))
    )
    rows = np.array([1, 2, 6])
    result = list(clouds(scans, submaps, rows))
    np.testing.assert_allclose([points.sum(axis=0) for points in result], drawn[rows], atol=1e-9)
    assert len(result[0]) == sum(200 + i for i in range(1, 1 + sweeps))


def test_rows_hold_medians_and_95th_percentiles_of_each_part() -> None:
    # b: generation 10 10 40, retrieval 0.5, total 10.5 10.5 40.5; nine tenths of the way from the
    # second to the third: 37. a: totals 5 3 4.
    result = {(one["method"], one["number"]): one["value"] for one in BY_HAND.rows()}
    assert list(result) == [(method, part) for method in "abc" for part in PARTS]
    assert [result["b", part] for part in PARTS] == pytest.approx([10, 37, 0.5, 0.5, 10.5, 37.5])
    assert (result["a", "generation_ms"], result["a", "query_ms"]) == (2, 4)
    assert (
        BY_HAND.line()
        == "a 4.00 ms, b 10.50 ms, c 10.00 ms; medians of 3 queries, from points to places"
    )


def test_a_model_costs_its_file_and_what_its_training_took_if_it_was_trained_here(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("here", "elsewhere"):
        Path(name).write_bytes(bytes(2_500))
    Trace(wall_s=3.0, cpu_s=5.0, peak_memory_mb=70.0).write("here")
    result = list(
        cost_rows({ModelName("sci", "4way", 1): Path("here"), ModelName("m2dp"): Path("elsewhere")})
    )
    assert {(one["method"], one["variant"], one["seed"]) for one in result} == {
        ("sci", "4way", 1),
        ("m2dp", "", 0),
    }
    assert [(one["number"], one["value"]) for one in result if one["method"] == "m2dp"] == [
        ("model_mb", 0.0025)
    ]
    costs = {
        "model_mb": 0.0025,
        "train_cpu_s": 5.0,
        "train_wall_s": 3.0,
        "train_peak_memory_mb": 70.0,
    }
    assert {one["number"]: one["value"] for one in result[:-1]} == costs


def test_every_sample_is_recorded() -> None:
    kept = json.loads(json.dumps(BY_HAND.record()))
    assert kept["milliseconds"]["total"] == {
        "a": [5, 3, 4],
        "b": [10.5, 10.5, 40.5],
        "c": [8, 10, 12],
    }
    assert kept["milliseconds"]["generation"]["narrow"] == [10, 10, 40]
    about = {
        "machine": {"processor": "Abacus"},
        "views": BY_HAND.views,
        "k": 25,
        "points": [100, 300, 5_000],
    }
    assert {name: kept[name] for name in about} == about


def test_this_machine_has_a_processor_with_a_name() -> None:
    assert processor().strip()
    here = machine_record(busy=0.987)
    assert (here["processor"], here["busy"]) == (processor(), 0.99)
    assert here["versions"]["numpy"] == np.__version__


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Any:
    """The stage's module; it limits threads by the environment, which is put back."""
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(name, "1")
    monkeypatch.chdir(tmp_path)
    from stages import latency

    return latency


def test_the_stage_measures_each_method_of_a_study_with_its_model(
    stage: Any, tmp_path: Path
) -> None:
    drive(tmp_path / "artifacts", "2012-02-04", 6)
    rng = np.random.default_rng(0)
    views = Rows(
        rng.random((12, 192)).astype(np.float32), np.arange(12), np.tile(np.eye(4), (12, 1, 1))
    )
    model = M2dp().learn(views, np.arange(12), Progress())
    recipe = {"_target_": "pipeline.methods.m2dp.M2dp", **asdict(M2dp())}
    store.write_model(tmp_path / "artifacts/train/campus/10m/m2dp.zarr.zip", model, recipe)
    cfg = {
        "study": "campus",
        "simulated": True,
        "cells": "10m",
        "sequence": "2012-02-04",
        "scans": "artifacts/scans/campus",
        "submaps": "artifacts/submaps/campus",
        "models": "artifacts/train/campus/10m",
        "contenders": [["m2dp", "m2dp"]],
        "trained": [{"method": "m2dp"}],
        "queries": 4,
        "k": 3,
    }
    line = stage.main.run(
        OmegaConf.create(cfg | {"out": "artifacts/latency/campus/10m.csv", "samples": "10m.json"})
    )
    assert line.startswith("m2dp ")
    assert line.endswith(" ms; medians of 4 queries, from points to places")
    table = pd.read_csv("artifacts/latency/campus/10m.csv")
    assert table.columns.tolist() == [*COLUMNS]
    assert table["number"].tolist() == [*PARTS, "model_mb"]
    kept = json.loads(Path("10m.json").read_text())
    assert (kept["sequence"], kept["k"], len(kept["milliseconds"]["total"]["m2dp"])) == (
        "2012-02-04",
        3,
        4,
    )
