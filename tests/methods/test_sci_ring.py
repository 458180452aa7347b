"""SCI on a ring, on a few made-up places: it knows them however it is turned, and says how that is."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from pipeline.errors import InputError
from pipeline.matching.ranking import Model, Ranking, Rows
from pipeline.matching.rejection import ACCEPT_NOTHING, Evidence, Rejection
from pipeline.methods.sci_ring.sci_ring import SciRing
from pipeline.running.progress import Progress
from pipeline.views.scan_context import ScanContext
from tests.interrupted import same
from tests.matching.made import along

KINDS = ("combined", "entropy", "tempered_entropy", "energy", "feature_distance")
PLACES, EACH, SECTORS = 4, 10, 40
VIEW = ScanContext(rings=8, sectors=SECTORS, max_range_m=24.0, voxel_m=0.0, min_points=1)
SMALL = SciRing(
    epochs=16, batch=8, dropout=0.0, held_out_every_m=10, held_out_length_m=2, neighbour_m=11, precision="f32", threads=1
)
TRUTH = np.repeat(np.arange(PLACES), EACH)
YAW_DEG = np.random.default_rng(7).uniform(-180, 180, len(TRUTH))


def scene(number: int) -> np.ndarray:
    """Thirty poles (n, 3) around a place, x to the east."""
    rng = np.random.default_rng(number)
    xy_m, heights_m = rng.uniform(-17, 17, (30, 2)), rng.uniform(2, 14, 30)
    return np.concatenate([[(*xy, z) for z in np.arange(0.5, top, 0.5)] for xy, top in zip(xy_m, heights_m, strict=True)])


def rows(seed: int, yaw_deg: np.ndarray = YAW_DEG, first: int = 0) -> Rows:
    """Each scene seen EACH times with noise by sensors of these yaws, a metre apart along x."""
    path, rng = along(TRUTH, yaw_deg=yaw_deg), np.random.default_rng(seed)
    turns = path.world_T_anchor[:, :3, :3]
    seen = [(scene(first + place) + rng.normal(0, 0.1, 3)) @ turn for place, turn in zip(TRUTH.tolist(), turns, strict=True)]
    return replace(path, images=np.stack([VIEW(points) for points in seen]))


@pytest.fixture(scope="module")
def model() -> Model:
    return SMALL.learn(rows(2), TRUTH, Progress())


@pytest.fixture(scope="module")
def ranking(model: Model) -> Ranking:
    return SMALL.localizer(model)(rows(3), 3)


def off_deg(told: np.ndarray, true: np.ndarray) -> np.ndarray:
    off: np.ndarray = np.abs((told - true + 180) % 360 - 180)
    return off


def test_places_are_learned(model: Model, ranking: Ranking) -> None:
    assert (ranking.places[:, 0] == TRUTH).mean() > 0.9
    assert model["curves/loss"][-1] < 0.5 * model["curves/loss"][0]


@pytest.mark.parametrize("turn_deg", [0, 90, -130])
def test_a_sensor_turned_to_the_left_is_known_and_told_so(model: Model, turn_deg: float) -> None:
    """Its yaw in the world grows by as much; headings here are 72° apart, so an answer lies between them."""
    yaw_deg = YAW_DEG + turn_deg
    found = SMALL.localizer(model)(rows(2, yaw_deg), 1)
    assert (found.places[:, 0] == TRUTH).mean() > 0.9
    assert np.median(off_deg(found.heading_deg[:, 0], yaw_deg)) < 12
    assert ((found.heading_deg > -180) & (found.heading_deg <= 180)).all()


def test_a_view_rolled_by_a_heading_is_answered_as_before_but_turned(model: Model, ranking: Ranking) -> None:
    # 8 of 40 columns: what was seen at azimuth a is seen at a + 72°, so the sensor looks 72° less to the left.
    views = rows(3)
    found = SMALL.localizer(model)(replace(views, images=np.roll(views.images, 8, axis=2)), 3)
    assert found.places.tolist() == ranking.places.tolist()
    np.testing.assert_allclose(found.costs, ranking.costs, atol=1e-6)
    np.testing.assert_allclose(found.novelty, ranking.novelty, atol=1e-5)
    np.testing.assert_allclose(off_deg(found.heading_deg, ranking.heading_deg - 72), 0, atol=1e-2)


def test_the_first_answer_lies_where_the_likest_training_view_stands_the_others_at_their_places_mean(ranking: Ranking) -> None:
    # Place p holds x = 10 p … 10 p + 9, whose mean is 10 p + 4.5; views stand a metre apart.
    first_m = ranking.xy_m[:, 0, 0]
    assert set(first_m) <= set(range(len(TRUTH)))
    assert (first_m // EACH == TRUTH).mean() > 0.9
    assert len(set(first_m)) > PLACES
    np.testing.assert_allclose(ranking.xy_m[:, 1:, 0], 10 * ranking.places[:, 1:] + 4.5)
    np.testing.assert_array_equal(ranking.xy_m[..., 1], 0)


def test_memory_looks_one_way_whatever_way_training_did(model: Model) -> None:
    """Views of one place are alike in it, though each was seen at another yaw."""
    memory = model["memory"]
    np.testing.assert_allclose(np.linalg.norm(memory, axis=1), 1, atol=1e-5)
    cosine = memory @ memory.T
    alike = TRUTH[:, None] == TRUTH
    assert cosine[alike].min() > np.quantile(cosine[~alike], 0.9)


def test_novelty_is_higher_for_unknown_scenes(model: Model, ranking: Ranking) -> None:
    unknown = SMALL.localizer(model)(rows(4, first=PLACES), 1)
    assert ranking.kinds == KINDS
    np.testing.assert_allclose(ranking.novelty[:, 0], ranking.novelty[:, 2] * ranking.novelty[:, 4], rtol=1e-5, atol=1e-7)
    for column in range(len(KINDS)):
        assert np.median(unknown.novelty[:, column]) > np.median(ranking.novelty[:, column])


def test_noise_on_the_training_yaw_is_seeded() -> None:
    noisy = replace(SMALL, yaw_noise_deg=40.0, epochs=1)
    once, again = (noisy.learn(rows(2), TRUTH, Progress()) for _ in range(2))
    assert same(once, again)
    assert not same(once, replace(noisy, yaw_noise_deg=0.0).learn(rows(2), TRUTH, Progress()))


def test_a_wedge_of_up_to_its_width_is_emptied_in_each_training_view() -> None:
    heights = torch.full((200, 8, SECTORS), 200, dtype=torch.uint8)
    given = heights, along(np.empty(200)), torch.zeros(200, dtype=torch.int64), torch.arange(200)
    plain, erased = (replace(SMALL, colormap="grey", erased_deg=deg).batches(*given)[0] for deg in (0.0, 90.0))
    whole, gaps = (torch.cat([images for images, _, _ in epoch(torch.Generator().manual_seed(0))]) for epoch in (plain, erased))
    assert (whole > 0).all()
    empty = (gaps == 0).all(dim=(1, 2))
    assert torch.equal(empty, (gaps == 0).any(dim=2).any(dim=1))  # whole columns
    widths = empty.sum(1)
    assert 0 <= int(widths.min()) < 3
    assert 8 <= int(widths.max()) <= SECTORS // 4 + 1
    assert (empty.int().diff(dim=1, prepend=empty[:, -1:].int()) == 1).sum(1).max() == 1  # one wedge, around the seam too
    assert empty.any(0).all()  # anywhere


def test_a_path_too_short_for_blocks_is_learned_all_the_same() -> None:
    short = replace(SMALL, held_out_every_m=1000.0, colormap="grey")
    learned = short.learn(rows(2), TRUTH, Progress(budget=0.05))
    assert len(learned["curves/loss"]) == 1
    assert learned["net/features.0.weight"].shape[1] == 1


def test_views_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match="multiple of 8 sectors"):
        SMALL.learn(replace(rows(3), images=rows(3).images[:, :, :36]), TRUTH, Progress())


def test_held_out_queries_look_newer_once_their_surroundings_are_forgotten(model: Model) -> None:
    evidence = Evidence.of(model)
    assert evidence.right.mean() > 0.8
    for kind in KINDS:
        assert np.median(evidence.unseen[kind]) > np.median(evidence.seen[kind])
    assert max(Rejection().thresholds(model, KINDS)) > ACCEPT_NOTHING


def test_the_target_is_shared_by_the_two_headings_nearest_the_true_one() -> None:
    # Two headings, three places, chances in twelfths: place 1 has 2 at heading 0 and 6 at heading 1. A yaw of 1.25 headings is
    # three quarters of the first after the last, heading 1, and a quarter of heading 0: −(.75 ln 6/12 + .25 ln 2/12).
    chances = torch.tensor([[[1.0, 2.0, 1.0], [1.0, 6.0, 1.0]]]) / 12
    batch = (torch.zeros(1, 1, 1, 1), torch.tensor([1]), torch.tensor([1.25]))
    loss, right, count = SMALL.step(lambda images: chances.log() + 3, batch)
    assert float(loss) == pytest.approx(-(0.75 * np.log(1 / 2) + 0.25 * np.log(1 / 6)))
    assert (int(right), count) == (1, 1)
    back = (batch[0], batch[1], torch.tensor([-0.75]))  # the same yaw, a whole turn less
    assert float(SMALL.step(lambda images: chances.log(), back)[0]) == pytest.approx(float(loss))
