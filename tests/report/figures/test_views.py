"""A place as driven and altered, beside its images."""

import numpy as np

from pipeline.alterations.construction import Construction
from pipeline.report.figures.views import altered, place
from pipeline.views.scan_context import ScanContext

VIEW = ScanContext(rings=8, sectors=12, max_range_m=24.0, voxel_m=0.0, min_points=1)
GROUND_M = np.column_stack(
    [*np.random.default_rng(0).uniform(-24, 24, (2, 500)), np.full(500, 0.01)]
)
WALLS = Construction(walls=(2,), shadows=(False,))


def test_an_altered_cloud_stands_below_the_one_as_driven() -> None:
    clouds_m = altered(GROUND_M, WALLS, stamp_ns=7)
    assert list(clouds_m) == ["as driven", "construction 2 walls"]
    driven, built = clouds_m.values()
    assert driven is GROUND_M
    assert built[:, 2].max() > 3 - 0.2 > driven[:, 2].max()  # a wall has 3 m at least
    assert altered(GROUND_M, WALLS, 7)["construction 2 walls"].tobytes() == built.tobytes()


def test_the_panels_show_each_clouds_heights_and_colours() -> None:
    clouds_m = altered(GROUND_M, WALLS, stamp_ns=7)
    axes = place(clouds_m, VIEW).axes
    contexts = [axes[1].images[0].get_array(), axes[4].images[0].get_array()]
    for shown, points_m in zip(contexts, clouds_m.values(), strict=True):
        heights_m = VIEW(points_m)
        np.testing.assert_array_equal(np.ma.filled(shown, 0.0), heights_m)
        assert np.ma.getmaskarray(shown).sum() == (heights_m == 0).sum()
    assert axes[2].images[0].get_array().shape == (8, 12, 3)
    assert [axis.get_ylabel() for axis in axes[::3]] == ["as driven", "construction 2 walls"]
