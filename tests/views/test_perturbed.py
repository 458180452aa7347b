"""Views of perturbed queries: each case changes the points, and a bird-view's map or pose."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from pipeline.core import schemas
from pipeline.core.compute import Compute
from pipeline.core.frames import pose, yaw
from pipeline.matching.ranking import Rows
from pipeline.perturbations import TURNED, UNCHANGED, Case
from pipeline.perturbations.construction import Construction
from pipeline.perturbations.demolition import Demolition
from pipeline.perturbations.several import Several
from pipeline.perturbations.turned import Turned, turned
from pipeline.views.draw import Drawing
from pipeline.views.mapped import MappedViews
from pipeline.views.perturbed import PerturbedRows, perturbed
from tests.views.made import BIRDVIEW, Artifacts, artifacts, lit, poles

ALL = Several([Turned(repeats=2), Demolition(), Construction()])


class Points:
    """A view that shows the points themselves."""

    schema = schemas.CloudViews

    def __call__(self, points_m: np.ndarray) -> np.ndarray:
        return points_m


class Summary(Points):
    """A view of four numbers: how many points there are, and their mean."""

    def __call__(self, points_m: np.ndarray) -> np.ndarray:
        return np.array([len(points_m), *points_m.mean(axis=0)], np.float32)


@dataclass(frozen=True)
class Fixed:
    """A perturbation with two cases beside the unperturbed one.

    In one every robot is turned by `left_deg`; in the other a scan misses all its points if its
    random number is below a half.
    """

    left_deg: float = 0.0
    seed: int = 0
    cases: Sequence[Case] = (Case(), Case(TURNED), Case("missed"))

    def perturb(
        self, case: Case, points_m: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, float]:
        if case.change == TURNED:
            return turned(points_m, math.radians(self.left_deg)), math.radians(self.left_deg)
        if case.change != UNCHANGED and rng.random() < 0.5:
            return points_m[:0], 0.0
        return points_m, 0.0


@pytest.fixture(params=[0, 2], ids=["single", "gathered"])
def driven(tmp_path: Path, request: pytest.FixtureRequest) -> Artifacts:
    """Artifacts of six scans of 200 points along a bend; a submap gathers one scan, or three."""
    rng = np.random.default_rng(4)
    clouds = [rng.uniform((-30, -30, 0), (30, 30, 9), (200, 3)) for _ in range(6)]
    bend = pose(
        np.cumsum(rng.uniform(0, 2, (6, 3)), axis=0), np.cumsum(rng.normal(0, 0.2, (6, 3)), axis=0)
    )
    rows = range(request.param, 6)
    return artifacts(tmp_path, clouds, bend, first=[row - request.param for row in rows], last=rows)


@dataclass(frozen=True)
class Nothing(Fixed):
    """A perturbation that changes nothing in any case."""

    def perturb(
        self, case: Case, points_m: np.ndarray, rng: np.random.Generator
    ) -> tuple[np.ndarray, float]:
        return points_m, 0.0


def test_all_cases_but_the_unperturbed_one_are_drawn_of_every_submap(driven: Artifacts) -> None:
    drawn = perturbed(*driven, Summary(), ALL)
    assert tuple(drawn) == ALL.cases[1:]
    assert {len(rows.images) for rows in drawn.values()} == {len(driven[1].load("scans"))}


def test_a_case_that_changes_nothing_is_what_the_stage_of_the_view_draws(driven: Artifacts) -> None:
    rows = Rows(*perturbed(*driven, Summary(), Nothing())[Case("missed")])
    stage = np.concatenate(list(Drawing(*driven, Summary()).blocks(Compute(workers=1))))
    assert rows.images.tobytes() == stage.tobytes()
    assert rows.images.dtype == stage.dtype
    for name in ("stamps_ns", "world_T_anchor"):
        np.testing.assert_array_equal(getattr(rows, name), driven[1].load(name))


def test_each_case_is_drawn_from_the_perturbed_points(driven: Artifacts) -> None:
    submaps = list(Drawing(*driven, Summary()).points())
    for case, rows in perturbed(*driven, Summary(), ALL).items():
        rngs = [np.random.default_rng((0, stamp)) for stamp in rows.stamps_ns]
        wanted = [
            Summary()(ALL.perturb(case, points, rng)[0])
            for points, rng in zip(submaps, rngs, strict=True)
        ]
        np.testing.assert_array_equal(rows.images, wanted)


def test_a_turned_robot_sees_the_same_world(driven: Artifacts) -> None:
    unperturbed = PerturbedRows(
        np.stack(list(Drawing(*driven, Points()).points())),
        *map(driven[1].load, ("stamps_ns", "world_T_anchor")),
    )
    drawn = [unperturbed, *perturbed(*driven, Points(), Turned()).values()]
    headings = [yaw(rows.world_T_anchor) for rows in drawn]
    assert len({heading for case in headings for heading in case}) == 6 * len(headings[0])
    worlds = [
        rows.images @ rows.world_T_anchor[:, :3, :3].swapaxes(1, 2)
        + rows.world_T_anchor[:, None, :3, 3]
        for rows in drawn
    ]
    for rows, world in zip(drawn[1:], worlds[1:], strict=True):
        assert np.abs(rows.images - drawn[0].images).max() > 1
        np.testing.assert_allclose(world, worlds[0], atol=1e-9)


@pytest.mark.parametrize("case", [Case(TURNED), Case("missed")])
def test_bird_views_of_a_case_that_changes_nothing_are_what_the_stage_draws(
    tmp_path: Path, case: Case
) -> None:
    scans, submaps = poles(tmp_path)
    drawn = perturbed(scans, submaps, BIRDVIEW, Nothing())
    stage = np.stack(list(MappedViews(scans, submaps, BIRDVIEW)))
    assert lit(stage) == [1, 2, 3]
    np.testing.assert_array_equal(drawn[case].images, stage)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_a_robot_turned_by_a_quarter_stands_so_in_the_same_map(
    tmp_path: Path, quarters: int
) -> None:
    """With eight headings a quarter turn is two of them: image h shows what image h + 2 showed of
    the unperturbed robot."""
    still, left = (
        perturbed(*poles(tmp_path), BIRDVIEW, Fixed(angle)) for angle in (0.0, 90.0 * quarters)
    )
    straight = still[Case(TURNED)].images
    turned = left[Case(TURNED)].images
    rolled = np.roll(straight, -2 * quarters, axis=1)
    assert (rolled != straight).any()
    # A pixel may differ by one of its sixteen samples.
    np.testing.assert_allclose(turned.astype(int), rolled.astype(int), atol=16)
    np.testing.assert_allclose(
        yaw(left[Case(TURNED)].world_T_anchor) % (2 * math.pi), math.pi / 2 * quarters
    )


def test_every_scan_of_a_map_is_perturbed_by_its_own_draw(tmp_path: Path) -> None:
    draws = {stamp: np.random.default_rng((0, stamp)).random() for stamp in range(20)}
    kept, missed = (
        next(stamp for stamp, draw in draws.items() if (draw < 0.5) is low) for low in (False, True)
    )
    later = next(stamp for stamp, draw in draws.items() if stamp > kept and draw >= 0.5)
    drawn = perturbed(*poles(tmp_path, stamps_ns=[kept, missed, later]), BIRDVIEW, Fixed())
    # the second scan's pole is missed, also by the third submap
    assert lit(drawn[Case("missed")].images) == [1, 1, 2]
    assert lit(drawn[Case(TURNED)].images) == [1, 2, 3]
