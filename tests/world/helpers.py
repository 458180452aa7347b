"""What the tests of the three worlds share."""

from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from pipeline.world.driving.entry import Entry
from pipeline.world.layout.campus import shapes_on
from pipeline.world.layout.routes import Routes
from pipeline.world.layout.shapes import Kind
from pipeline.world.simulation import Simulation

CONF = Path(__file__).parents[2] / "conf" / "world"


def preset(name: str) -> Simulation:
    """A world of conf/world."""
    keys = yaml.safe_load((CONF / f"{name}.yaml").read_text())
    assert keys.pop("_target_") == "pipeline.world.simulation.Simulation"
    return Simulation(**keys)


def contents(root: Path) -> list[tuple[str, bytes]]:
    """All files below a folder, by name."""
    return sorted((str(path.relative_to(root)), path.read_bytes()) for path in root.rglob("*") if path.is_file())


def off_walls_m(
    world: Simulation, sequence: str, points_m: NDArray[np.float64], routes: Routes | None = None
) -> NDArray[np.float64]:
    """Distance (n,) of `points_m` (n, 3) of the world to the nearest face of a building that stands on the sequence's day."""
    routes = routes or world.routes()
    campus, _ = world._year(routes, Entry.of(sequence, world.sequences[sequence]))
    box = shapes_on(campus, world._day(sequence))[0]
    box = box[box["kind"] == Kind.BUILDING]
    east, north, up = points_m.T[..., None]
    ahead = (east - box["x_m"]) * box["cos_yaw"] + (north - box["y_m"]) * box["sin_yaw"]
    left = (north - box["y_m"]) * box["cos_yaw"] - (east - box["x_m"]) * box["sin_yaw"]
    beyond = np.stack([np.abs(ahead) - box["half_length_m"], np.abs(left) - box["half_width_m"], up - box["top_m"]])
    # Outside of a box over the positive axes, inside of it to the nearest face.
    outside_m = np.linalg.norm(beyond.clip(min=0), axis=0) - beyond.max(0).clip(max=0)
    return np.asarray(outside_m.min(1))
