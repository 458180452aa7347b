"""What the tests of several worlds share: presets, recordings, and checks of what was recorded."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import yaml

from pipeline.core.compute import Compute
from pipeline.core.errors import ConfigError
from pipeline.core.progress import Progress
from worlds.driving.entry import Entry
from worlds.driving.recorder import Recording
from worlds.layout.campus import shapes_on
from worlds.layout.ground import Ground
from worlds.layout.routes import Routes
from worlds.layout.shapes import Kind
from worlds.simulation import Simulation

ALONE = Compute(workers=1)
CONF = Path(__file__).parents[2] / "conf" / "world"
EVEN = {"unseen": 0.0, "reversed": 0.0}
FLAT = Ground(np.zeros((600, 40)), -100.0, -100.0)


def preset(name: str) -> Simulation:
    """The world of a yaml in conf/world."""
    keys = yaml.safe_load((CONF / f"{name}.yaml").read_text())
    assert keys.pop("_target_") == "worlds.simulation.Simulation"
    return Simulation(**keys)


def record(
    world: Simulation,
    sequence: str,
    root: Path,
    ground_truth: Path | None = None,
    compute: Compute = ALONE,
) -> Recording:
    """Record a sequence into the folder of its name below `root`."""
    return world.record(sequence, root / sequence, compute, Progress(), ground_truth)


@contextmanager
def refused(match: str | None = None) -> Iterator[None]:
    """Expects that a setting is refused, with an error of one line."""
    with pytest.raises(ConfigError, match=match) as error:
        yield
    assert "\n" not in str(error.value)


def contents(root: Path) -> list[tuple[str, bytes]]:
    """The name and the bytes of all files below a folder, sorted by name."""
    return sorted(
        (str(path.relative_to(root)), path.read_bytes())
        for path in root.rglob("*")
        if path.is_file()
    )


def shares(path: np.ndarray, training: np.ndarray) -> tuple[float, float]:
    """The shares of poses (n, 4, 4) that are unseen, and of the others that are driven in reverse.

    A pose is unseen if it is further than 10 m from all those of training (m, 4, 4).
    """
    gaps_m = np.linalg.norm(path[:, None, :2, 3] - training[None, :, :2, 3], axis=2)
    seen = gaps_m.min(1) < 10.0
    same_way = ((path[:, :2, 0] @ training[:, :2, 0].T > 0) & (gaps_m < 10.0)).any(1)
    return 1 - seen.mean(), (seen & ~same_way).sum() / seen.sum()


def off_walls_m(
    world: Simulation, sequence: str, points_m: np.ndarray, routes: Routes | None = None
) -> np.ndarray:
    """Distance (n,) of world points (n, 3) to the nearest face of a building.

    Buildings are those that stand on the sequence's day.
    """
    campus, _ = world.year_of(
        routes or world.routes(), Entry.of(sequence, world.sequences[sequence])
    )
    box = shapes_on(campus, world.day_of(sequence))[0]
    box = box[box["kind"] == Kind.BUILDING]
    east, north, up = points_m.T[..., None]
    ahead = (east - box["x_m"]) * box["cos_yaw"] + (north - box["y_m"]) * box["sin_yaw"]
    left = (north - box["y_m"]) * box["cos_yaw"] - (east - box["x_m"]) * box["sin_yaw"]
    beyond = np.stack(
        [
            np.abs(ahead) - box["half_length_m"],
            np.abs(left) - box["half_width_m"],
            up - box["top_m"],
        ]
    )
    # Outside of a box it is the length of the positive parts, inside of it the way to the nearest
    # face.
    outside_m = np.linalg.norm(beyond.clip(min=0), axis=0) - beyond.max(0).clip(max=0)
    return np.asarray(outside_m.min(1))
