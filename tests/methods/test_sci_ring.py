"""Tests of SCI on a ring, on a few made-up places: it recognises them at any heading, and tells the
heading."""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import torch

from pipeline.core.errors import InputError
from pipeline.core.progress import Progress
from pipeline.matching import holdout
from pipeline.matching.ranking import Model, Ranking, Rows
from pipeline.matching.rejection import ACCEPT_NOTHING, NoveltyEvidence, Rejection
from pipeline.methods.sci_ring.sci_ring import Batch, SciRing
from pipeline.views.scan_context import ScanContext
from tests.interrupted import PowerCut, same
from tests.learning import Clears
from tests.matching.made import along

KINDS = ("combined", "entropy", "tempered_entropy", "energy", "feature_distance")
PLACES = 4
EACH = 10
SECTORS = 40
VIEW = ScanContext(rings=8, sectors=SECTORS, max_range_m=24.0, voxel_m=0.0, min_points=1)
SMALL = SciRing(
    epochs=16,
    batch=8,
    dropout=0.0,
    validation_every_m=10,
    validation_length_m=2,
    neighbour_m=11,
    precision="f32",
    threads=1,
    refit=0.0,
)
GROUND_TRUTH = np.repeat(np.arange(PLACES), EACH)
YAW_DEG = np.random.default_rng(7).uniform(-180, 180, len(GROUND_TRUTH))


def scene(number: int) -> np.ndarray:
    """Thirty poles (n, 3) around a place, x to the east."""
    rng = np.random.default_rng(number)
    xy_m = rng.uniform(-17, 17, (30, 2))
    heights_m = rng.uniform(2, 14, 30)
    return np.concatenate(
        [
            [(*xy, z) for z in np.arange(0.5, top, 0.5)]
            for xy, top in zip(xy_m, heights_m, strict=True)
        ]
    )


def rows(seed: int, yaw_deg: np.ndarray = YAW_DEG, first: int = 0) -> Rows:
    """Each scene seen EACH times with noise by sensors of these yaws, a metre apart along x."""
    path = along(GROUND_TRUTH, yaw_deg=yaw_deg)
    rng = np.random.default_rng(seed)
    turns = path.world_T_anchor[:, :3, :3]
    seen = [
        (scene(first + place) + rng.normal(0, 0.1, 3)) @ turn
        for place, turn in zip(GROUND_TRUTH.tolist(), turns, strict=True)
    ]
    return replace(path, images=np.stack([VIEW(points) for points in seen]))


@pytest.fixture(scope="module")
def model(seed: int) -> Model:
    return replace(SMALL, seed=seed).learn(rows(2), GROUND_TRUTH, Progress())


@pytest.fixture(scope="module")
def ranking(model: Model) -> Ranking:
    return SMALL.localizer(model)(rows(3), 3)


def off_deg(reported: np.ndarray, true: np.ndarray) -> np.ndarray:
    off: np.ndarray = np.abs((reported - true + 180) % 360 - 180)
    return off


@pytest.mark.learning
def test_places_are_learned(model: Model, ranking: Ranking, clears: Clears) -> None:
    clears((ranking.places[:, 0] == GROUND_TRUTH).mean(), 0.8)
    clears(1 - model["curves/loss"][-1] / model["curves/loss"][0], 0.5)


@pytest.mark.learning
@pytest.mark.parametrize("turn_deg", [0, 90, -130])
def test_a_sensor_turned_to_the_left_is_known_and_reported_so(
    model: Model, turn_deg: float, clears: Clears
) -> None:
    """Its yaw in the world is larger by as much; headings here are 72° apart, so an answer lies
    between them."""
    yaw_deg = YAW_DEG + turn_deg
    result = SMALL.localizer(model)(rows(2, yaw_deg), 1)
    clears((result.places[:, 0] == GROUND_TRUTH).mean(), 0.8)
    clears(1 - np.median(off_deg(result.heading_deg[:, 0], yaw_deg)) / 72, 1 - 20 / 72)
    assert ((result.heading_deg > -180) & (result.heading_deg <= 180)).all()


def test_a_view_rolled_by_a_heading_is_answered_as_before_but_turned(
    model: Model, ranking: Ranking
) -> None:
    # 8 of 40 columns: what was seen at azimuth a is seen at a + 72°, so the sensor looks 72° less
    # to the left.
    views = rows(3)
    result = SMALL.localizer(model)(replace(views, images=np.roll(views.images, 8, axis=2)), 3)
    assert result.places.tolist() == ranking.places.tolist()
    np.testing.assert_allclose(result.costs, ranking.costs, atol=1e-6)
    np.testing.assert_allclose(result.novelty, ranking.novelty, atol=1e-5)
    np.testing.assert_allclose(off_deg(result.heading_deg, ranking.heading_deg - 72), 0, atol=1e-2)


def test_the_first_answer_lies_where_the_likest_training_view_stands_the_others_at_their_places_mean(
    ranking: Ranking,
) -> None:
    # Place p holds x = 10 p … 10 p + 9, whose mean is 10 p + 4.5; views stand a metre apart.
    first_m = ranking.xy_m[:, 0, 0]
    assert set(first_m) <= set(range(len(GROUND_TRUTH)))
    assert (first_m // EACH == GROUND_TRUTH).mean() > 0.9
    assert len(set(first_m)) > PLACES
    np.testing.assert_allclose(ranking.xy_m[:, 1:, 0], 10 * ranking.places[:, 1:] + 4.5)
    np.testing.assert_array_equal(ranking.xy_m[..., 1], 0)


def test_memory_looks_one_way_whatever_way_training_did(model: Model) -> None:
    """Views of one place are similar in it, though each was seen at another yaw."""
    memory = model["memory"]
    np.testing.assert_allclose(np.linalg.norm(memory, axis=1), 1, atol=1e-5)
    cosine = memory @ memory.T
    similar = GROUND_TRUTH[:, None] == GROUND_TRUTH
    assert cosine[similar].min() > np.quantile(cosine[~similar], 0.9)


def test_novelty_is_higher_for_unknown_scenes(model: Model, ranking: Ranking) -> None:
    unknown = SMALL.localizer(model)(rows(4, first=PLACES), 1)
    assert ranking.kinds == KINDS
    np.testing.assert_allclose(
        ranking.novelty[:, 0], ranking.novelty[:, 2] * ranking.novelty[:, 4], rtol=1e-5, atol=1e-7
    )
    for column in range(len(KINDS)):
        assert np.median(unknown.novelty[:, column]) > np.median(ranking.novelty[:, column])


def test_noise_on_the_training_yaw_is_seeded() -> None:
    noisy = replace(SMALL, yaw_noise_deg=40.0, epochs=1)
    once, again = (noisy.learn(rows(2), GROUND_TRUTH, Progress()) for _ in range(2))
    assert same(once, again)
    assert not same(
        once, replace(noisy, yaw_noise_deg=0.0).learn(rows(2), GROUND_TRUTH, Progress())
    )


def test_each_batch_leaves_out_arcs_of_one_width_at_most_the_widest_and_never_all_around() -> None:
    heights = torch.zeros(64, 8, SECTORS, dtype=torch.uint8)
    given = heights, along(np.empty(64)), torch.zeros(64, dtype=torch.int64), torch.arange(64)

    def widths(**settings: float) -> set[int]:
        epoch, _ = replace(SMALL, batch=2, **settings).batches(*given)
        return {arc for _, _, arc, _ in epoch(torch.Generator().manual_seed(0))}

    assert widths(widest_arc=3) == {1, 2, 3}
    assert widths(widest_arc=9) == {1, 2, 3, 4}  # of five sectors
    assert widths(worst_arc=0.0) == {0}


def test_a_refit_learns_the_validation_views_too_and_leaves_what_they_chose(model: Model) -> None:
    before = model
    after = replace(SMALL, refit=0.5).learn(rows(2), GROUND_TRUTH, Progress())
    chosen = [
        name
        for name in before
        if name.startswith(("validation/", "curves/")) or name in ("temperature", "best_epoch")
    ]
    assert all(np.array_equal(before[name], after[name]) for name in chosen)
    assert not np.array_equal(before["net/fc2.weight"], after["net/fc2.weight"])
    held = holdout.blocks(
        rows(2).world_T_anchor, GROUND_TRUTH, SMALL.validation_every_m, SMALL.validation_length_m
    )
    seen = replace(rows(2), images=rows(2).images[held])

    def cost(model: Model) -> float:
        return float(SMALL.localizer(model)(seen, 1).costs.mean())

    assert cost(after) < cost(before)


@dataclass(frozen=True)
class CutInRefit(Progress):
    def part(self, name: str) -> Progress:
        return PowerCut(checkpoint=super().part(name).checkpoint, at=3)


def test_a_refit_that_was_interrupted_goes_on_to_the_same_weights(tmp_path: Path) -> None:
    method = replace(SMALL, refit=0.5, epochs=6, dropout=0.3)
    checkpoint = tmp_path / "half.safetensors"
    with pytest.raises(KeyboardInterrupt):
        method.learn(rows(2), GROUND_TRUTH, CutInRefit(checkpoint=checkpoint))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "half-refit.safetensors",
        "half.safetensors",
    ]
    assert same(
        method.learn(rows(2), GROUND_TRUTH, Progress(checkpoint=checkpoint)),
        method.learn(rows(2), GROUND_TRUTH, Progress()),
    )


def test_done_work_leaves_no_checkpoint_of_any_part(tmp_path: Path) -> None:
    progress = Progress(checkpoint=tmp_path / "one.safetensors")
    replace(SMALL, refit=0.5, epochs=2).learn(rows(2), GROUND_TRUTH, progress)
    assert len(list(tmp_path.iterdir())) == 2
    progress.done()
    Progress().done()
    assert not list(tmp_path.iterdir())


def test_views_of_another_shape_are_refused() -> None:
    with pytest.raises(InputError, match="multiple of 8 sectors"):
        SMALL.learn(replace(rows(3), images=rows(3).images[:, :, :36]), GROUND_TRUTH, Progress())


def test_validation_queries_look_newer_once_their_surroundings_are_forgotten(model: Model) -> None:
    evidence = NoveltyEvidence.of(model)
    assert evidence.right.mean() > 0.8
    for kind in KINDS:
        assert np.median(evidence.unseen[kind]) > np.median(evidence.seen[kind])
    assert (
        max(
            reject_from
            for reject_from, _ in Rejection(target_precision=0.5).thresholds(model, KINDS)
        )
        > ACCEPT_NOTHING
    )


def test_the_target_is_shared_by_the_two_headings_nearest_the_true_one() -> None:
    # Two headings, three places, probabilities in twelfths: place 1 has 2 at heading 0 and 6 at
    # heading 1. A yaw of 1.25 headings is three quarters of the first after the last, heading 1,
    # and a quarter of heading 0: −(.75 ln 6/12 + .25 ln 2/12).
    probabilities = torch.tensor([[[1.0, 2.0, 1.0], [1.0, 6.0, 1.0]]]) / 12
    batch = Batch(torch.zeros(1, 1, 1, 1), torch.tensor([1]), 0, torch.tensor([1.25]))
    loss, right, count = SMALL.step(lambda images, arc: probabilities.log()[:, None] + 3, batch)
    assert float(loss) == pytest.approx(-(0.75 * np.log(1 / 2) + 0.25 * np.log(1 / 6)))
    assert (int(right), count) == (1, 1)
    back = batch._replace(headings=torch.tensor([-0.75]))  # the same yaw, a whole turn less
    assert float(
        SMALL.step(lambda images, arc: probabilities.log()[:, None], back)[0]
    ) == pytest.approx(float(loss))


@pytest.mark.parametrize(("share", "expected"), [(0.0, 2), (0.5, 3), (1.0, 4)])
def test_the_loss_is_shared_with_the_arc_that_costs_most(share: float, expected: float) -> None:
    # One heading, two places, the first true: probabilities of 1/4 whole, 1/16 and 1/8 without each
    # arc, of sums that are 1: in bits.
    probabilities = torch.tensor([1 / 4, 1 / 16, 1 / 8])
    logits = torch.stack([probabilities, 1 - probabilities], dim=1).log()[None, :, None]
    batch = Batch(torch.zeros(1, 1, 1, 1), torch.tensor([0]), 1, torch.tensor([0.0]))
    loss, _, _ = replace(SMALL, worst_arc=share).step(lambda images, arc: logits, batch)
    assert float(loss) / np.log(2) == pytest.approx(expected)
