"""Tests of Scan Context-50 and the exhaustive search: rankings, headings, and evidence on
validation blocks."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from pipeline.core.progress import Progress
from pipeline.matching.database import Database
from pipeline.matching.ranking import Localizer, Ranking, Rows
from pipeline.matching.rejection import ACCEPT_NOTHING, NoveltyEvidence, Rejection
from pipeline.matching.shift_method import ring_keys
from pipeline.matching.shifts import Spectra
from pipeline.methods.scan_context import ScanContext50
from pipeline.methods.scan_context_all import ScanContextAll
from pipeline.readers.kitti import read_poses, read_velodyne
from pipeline.readers.nclt import read_velodyne_sync
from pipeline.views.scan_context import ScanContext
from tests.matching.made import along

FIFTY = ScanContext50()
ALL = ScanContextAll()
BOTH = pytest.mark.parametrize("method", [FIFTY, ALL], ids=["fifty", "all"])
Both = ScanContext50 | ScanContextAll
PLACES = 24
EACH = 4
GROUND_TRUTH = np.repeat(np.arange(PLACES), EACH)


def rows(seed: int, turn: int = 0, noise_m: float = 0.3) -> Rows:
    """PLACES sparse scenes seen EACH times, 2 m apart, with noise and a tenth of the bins lost,
    columns rolled by `turn`."""
    rng = np.random.default_rng(0)
    here = np.random.default_rng(seed)
    scenes = rng.uniform(1, 12, (PLACES, 10, 24)) * (
        rng.random((PLACES, 10, 24)) < rng.uniform(0.1, 0.5, (PLACES, 10, 1))
    )
    images = np.repeat(scenes, EACH, axis=0)
    images = (
        (images + here.normal(scale=noise_m, size=images.shape))
        * (images > 0)
        * (here.random(images.shape) < 0.9)
    )
    return along(np.roll(images, turn, axis=2).astype(np.float32), 2.0)


def asking(
    method: Both, views: Rows | None = None, places: NDArray[np.int64] = GROUND_TRUTH
) -> Localizer:
    return method.localizer(method.learn(rows(1) if views is None else views, places, Progress()))


def localized(method: Both, k: int = 5, turn: int = 0) -> Ranking:
    return asking(method)(rows(2, turn), k)


def one(images: NDArray[np.float32]) -> Rows:
    return along(images[None])


@BOTH
@pytest.mark.parametrize("turn", [0, 7])
def test_known_scenes_are_found_at_any_heading(method: Both, turn: int):
    ranking = localized(method, turn=turn)
    assert (ranking.places[:, 0] == GROUND_TRUTH).mean() > 0.98
    assert (np.diff(ranking.costs, axis=1) >= 0).all()
    assert (ranking.novelty[:, 0] == ranking.costs[:, 0]).all()
    assert ranking.kinds == ("distance",)
    # 24 sectors of 15°
    np.testing.assert_allclose(ranking.heading_deg[:, 0], 15 * ((-turn + 12) % 24 - 12), atol=1e-3)
    np.testing.assert_allclose(ranking.xy_m[:, 0, 0] // (2 * EACH), GROUND_TRUTH)


def test_the_exhaustive_search_misses_nothing_and_the_shortlist_may():
    everything = localized(ALL)
    few = localized(replace(FIFTY, candidates=5))
    np.testing.assert_allclose(
        localized(replace(FIFTY, candidates=1000)).costs, everything.costs, atol=1e-6
    )
    assert (few.costs[:, 0] >= everything.costs[:, 0]).all()
    assert (few.costs[:, -1] > everything.costs[:, -1]).any()


def test_only_the_candidates_of_the_nearest_ring_keys_are_compared():
    # Ring keys of one ring of four bins: 1, 2 and 3. The query holds 2: with one candidate it is
    # row 1, though row 2's columns, at cosine 1 wherever both are engaged, are no farther; row 0
    # comes next.
    heights = np.array([[[1, 0, 0, 0]], [[-1, -1, 0, 0]], [[1, 1, 1, 0]]], np.float32)
    views = along(heights)
    query = one(np.array([[2, 2, 0, 0]], np.float32))
    alone = asking(replace(FIFTY, candidates=1), views, np.arange(3))(query, 3)
    assert alone.places.tolist() == [[1]]
    assert alone.costs.tolist() == [[2]]  # opposite signs at every shift that engages anything
    assert asking(FIFTY, views, np.arange(3))(query, 3).costs.tolist() == [[0, 0, 2]]


@BOTH
def test_distinct_places_are_each_answered_once_at_their_nearest_scan(method: Both):
    scans = localized(method, k=25)
    places = localized(replace(method, distinct_places=True), k=5)
    assert all(len(set(answer)) == 5 for answer in places.places.tolist())
    for query in (0, 40):
        first = [scans.places[query].tolist().index(place) for place in places.places[query, :3]]
        np.testing.assert_allclose(places.costs[query, :3], scans.costs[query, first], atol=1e-6)
        np.testing.assert_allclose(places.xy_m[query, :3], scans.xy_m[query, first])


def test_ring_keys_count_bins_and_do_not_turn():
    heights_m = np.array([[[1.0, 0, -2, 0], [0, 0, 0, 0], [3, 3, 3, 0]]], np.float32)
    assert ring_keys(heights_m).tolist() == [[2, 0, 3]]
    images = rows(1).images
    np.testing.assert_array_equal(ring_keys(images), ring_keys(np.roll(images, 5, axis=2)))


@BOTH
def test_a_robot_that_turns_left_by_30_degrees_is_reported_so(method: Both):
    """Two clouds, seen where the robot learned them and again after it turned on the spot."""
    rng = np.random.default_rng(5)
    clouds = [
        np.stack([*rng.uniform(-60, 60, (2, 4000)), rng.uniform(0, 10, 4000)], axis=1)
        for _ in range(2)
    ]
    draw = ScanContext(voxel_m=0, min_points=1)
    learned_yaw_deg = 40.0
    turned_by_deg = 30.0

    def seen(cloud: NDArray[np.float64], yaw_deg: float) -> NDArray[np.float32]:
        c = np.cos(np.deg2rad(yaw_deg))
        s = np.sin(np.deg2rad(yaw_deg))
        world_R_robot = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        return draw(cloud @ world_R_robot)  # p_robot = world_R_robotᵀ p_world, for rows

    views = along(
        np.stack([seen(cloud, learned_yaw_deg) for cloud in clouds]), yaw_deg=learned_yaw_deg
    )
    localize = asking(method, views, np.arange(2))
    for place, cloud in enumerate(clouds):
        ranking = localize(one(seen(cloud, learned_yaw_deg + turned_by_deg)), 1)
        assert ranking.places.tolist() == [[place]]
        np.testing.assert_allclose(ranking.heading_deg, [[70]], atol=1e-3)


@BOTH
def test_an_empty_view_is_as_far_from_all_as_possible_and_has_no_heading(method: Both):
    ranking = asking(method)(one(np.zeros((10, 24), np.float32)), 3)
    assert ranking.costs.tolist() == [[1, 1, 1]]
    assert np.isnan(ranking.heading_deg).all()


@BOTH
def test_more_queries_than_fit_into_a_block_are_answered_in_order(method: Both):
    images = np.concatenate([rows(seed).images for seed in (2, 3, 4, 5)])
    ranking = asking(method)(along(images), 1)
    assert len(images) > 256
    assert (ranking.places[:, 0] == np.tile(GROUND_TRUTH, 4)).mean() > 0.98


@BOTH
def test_validation_blocks_are_found_and_look_newer_without_their_surroundings(method: Both):
    # 2 m a scan, 8 m a place: all that is nearer than 17 m includes the whole of the query's own.
    settled = replace(method, validation_every_m=40.0, validation_length_m=4.0, neighbour_m=17.0)
    model = settled.learn(rows(1), GROUND_TRUTH, Progress())
    evidence = NoveltyEvidence.of(model)
    assert evidence.right.all()
    assert (evidence.unseen["distance"] > evidence.seen["distance"]).all()
    # All right, a fifth of the queries unseen: of b blocks .8 b right ones, and one more counted
    # wrong.
    (threshold,) = Rejection(target_precision=0.5).thresholds(model, ("distance",))
    assert threshold.validation_precision >= 0.5
    assert threshold.reject_from > ACCEPT_NOTHING


def test_validation_rows_search_the_ring_keys_of_allowed_rows_only():
    """What the model says of its blocks is what a plain search over the allowed rows finds."""
    narrow = replace(FIFTY, candidates=1)
    views = rows(1)
    model = narrow.learn(views, GROUND_TRUTH, Progress())
    spectra = Spectra.of(model)
    keys = model["ring_keys"]
    database = Database.of(model)
    held = np.flatnonzero((2.0 * np.arange(len(GROUND_TRUTH)) + 20) % 40 < 4)
    rest = np.setdiff1d(np.arange(len(GROUND_TRUTH)), held)
    expected = []
    right = []
    for row in held:
        candidates = rest[
            np.argsort(np.linalg.norm(keys[rest] - keys[row], axis=1), kind="stable")[:1]
        ]
        distances, _ = spectra.compare(views.images[row], candidates)
        expected.append(distances.min())
        right.append(database.places[candidates[distances.argmin()]] == GROUND_TRUTH[row])
    np.testing.assert_allclose(model["validation/seen/distance"], expected, atol=1e-6)
    assert model["validation/right"].tolist() == right
    assert (
        FIFTY.learn(views, GROUND_TRUTH, Progress())["validation/seen/distance"]
        < model["validation/seen/distance"]
    ).any()


def test_a_real_reverse_loop_is_found_among_real_scans(real: Path):
    """KITTI 08, scan 1500, against 720, sixteen scans of KITTI 00 and one of NCLT: 720 comes first,
    148.4° away."""
    lift = np.array([0, 0, 1.73], np.float32)
    kitti = [
        real / "kitti/pairs/08/000720.bin",
        *sorted((real / "kitti/sequences/00/velodyne").glob("*.bin")),
    ]
    clouds = [read_velodyne(path) + lift for path in kitti]
    clouds.append(read_velodyne_sync(next((real / "nclt/2012-01-15/velodyne_sync").glob("*.bin"))))
    views = along(np.stack([ScanContext()(cloud) for cloud in clouds]))
    query = one(ScanContext()(read_velodyne(real / "kitti/pairs/08/001500.bin") + lift))
    for method in (FIFTY, replace(FIFTY, candidates=5), ALL):
        ranking = asking(method, views, np.arange(len(clouds)))(query, 3)
        assert ranking.places[0, 0] == 0
        np.testing.assert_allclose(ranking.heading_deg[:, 0], [-150], atol=1e-3)


def test_real_scans_of_one_street_are_nearest_to_their_neighbours(real: Path):
    """KITTI 00, sixteen consecutive scans about 0.9 m apart: each of the even ones, learned,
    answers the odd one beside it."""
    paths = sorted((real / "kitti/sequences/00/velodyne").glob("*.bin"))
    lift = np.array([0, 0, 1.73], np.float32)
    views = np.stack([ScanContext()(read_velodyne(path) + lift) for path in paths])
    world_T_scan = read_poses(real / "kitti/poses/00.txt", real / "kitti/sequences/00/calib.txt")[
        :16
    ]
    even, odd = (Rows(views[i::2], np.arange(8), world_T_scan[i::2]) for i in (0, 1))
    ranking = asking(ALL, even, np.arange(8))(odd, 1)
    away_m = np.linalg.norm(ranking.xy_m[:, 0] - world_T_scan[1::2, :2, 3], axis=1)
    assert (away_m < 2.7).all()
    assert (np.abs(ranking.heading_deg) < 4).all()
