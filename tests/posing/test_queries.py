"""Tests of the queries of a test sequence: the candidates that rankings name, and the points of
perturbed cases."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from pipeline.core import schemas, store
from pipeline.core.errors import InputError
from pipeline.core.frames import distance_and_turn, turns
from pipeline.perturbations import Case, generator
from pipeline.perturbations.turned import Turned
from pipeline.posing.queries import Queries
from pipeline.posing.search import Fixer
from pipeline.posing.targets import write_map
from tests.artifacts import write_scans, write_submaps
from tests.posing.scene import planar, scene, seen_from
from tests.readers.damage import one_line

CASES = [Case(), Case("turned", repeat=0)]
TRUE = np.stack([planar(0.5, 1.0, 20), planar(-1.0, 0.0, -70)])
STAMPS_NS = np.array([10, 20]) * 10**9


def drive(
    folder: Path, name: str, world_T_anchor: np.ndarray, clouds: Sequence[np.ndarray] = ()
) -> tuple[store.Artifact, store.Artifact]:
    """Scans of the scene, or these, and submaps of one each."""
    clouds = clouds or [seen_from(scene(), at) for at in world_T_anchor]
    stamps_ns = STAMPS_NS[0] * (1 + np.arange(len(world_T_anchor)))
    return (
        write_scans(folder / f"scans/{name}.zarr", clouds, world_T_anchor, stamps_ns=stamps_ns),
        write_submaps(folder / f"submaps/{name}.zarr", world_T_anchor, stamps_ns=stamps_ns),
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A map of one submap, two queries beside it, and their ranking unperturbed and turned, which
    names the right place."""
    write_map(tmp_path / "map.zarr", *drive(tmp_path, "train", np.eye(4)[None]), 0.5, 80.0, 50.0)
    drive(tmp_path, "test", TRUE)
    given = {
        "kinds": ("entropy",),
        "thresholds": (0.5,),
        "cases": [asdict(case) for case in CASES],
        "target_precision": 0.9,
    }
    given |= {"validation_precision": (0.9,)}
    with store.draft(tmp_path / "rankings" / "test.zarr", schemas.Rankings, **given) as out:
        for column, kind in schemas.Rankings.columns.items():
            shape = {"rank": 1, "xy": 2, "kind": 1}
            out.put(column, np.zeros([4, *(shape[dim] for dim in kind.dims[1:])], kind.dtype))
    return tmp_path


def queries(folder: Path, *perturbations: Turned) -> Queries:
    places = (str(folder / kind) for kind in ("scans", "submaps"))
    return Queries("test", *places, (str(folder / "rankings"),), perturbations)


def test_each_case_has_the_pose_of_the_robot_in_this_case(folder: Path) -> None:
    turned = Turned(repeats=1)
    fixes = queries(folder, turned).fixes(Fixer(rounds=(1,)), folder / "map.zarr", 1)
    left_rad = [
        turned.perturb(CASES[1], np.zeros((1, 3)), generator(turned, stamp))[1]
        for stamp in STAMPS_NS.tolist()
    ]
    away_m, turn_deg = distance_and_turn(
        np.array([fix.pose for fix in fixes]),
        np.concatenate([TRUE, TRUE @ turns(np.array(left_rad))]),
    )
    assert away_m.max() < 0.1
    assert turn_deg.max() < 0.5


def test_a_case_that_no_perturbation_makes_is_one_line(folder: Path) -> None:
    with one_line(
        InputError,
        r"rankings: a ranking of Case\(change='turned'.* which no perturbation given here makes",
    ):
        queries(folder).fixes(Fixer(rounds=(1,)), folder / "map.zarr", 1)


def test_a_ranking_of_other_queries_is_one_line(folder: Path) -> None:
    drive(folder, "other", TRUE[:1])
    (folder / "rankings" / "test.zarr").rename(folder / "rankings" / "other.zarr")
    other = Queries(
        "other",
        str(folder / "scans"),
        str(folder / "submaps"),
        (str(folder / "rankings"),),
        (Turned(repeats=1),),
    )
    with one_line(InputError, "a ranking of 4 queries; the submaps make 2 in all cases"):
        other.fixes(Fixer(rounds=(1,)), folder / "map.zarr", 1)
