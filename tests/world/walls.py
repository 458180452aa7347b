"""How far measured points lie off the true walls of a world."""

import numpy as np
from numpy.typing import NDArray

from pipeline.world.campus import build_campus, shapes_on
from pipeline.world.events import pass_a_year
from pipeline.world.robots import ROBOTS
from pipeline.world.routes import Routes
from pipeline.world.shapes import Kind
from pipeline.world.simulation import Simulation


def off_walls_m(
    world: Simulation, sequence: str, points_m: NDArray[np.float64], routes: Routes | None = None
) -> NDArray[np.float64]:
    """Distance (n,) of `points_m` (n, 3) of the world to the nearest face of a building that stands on the sequence's day."""
    routes = routes or world.routes()
    departs = ROBOTS[world.robot].departs
    day = departs(sequence).toordinal() - departs(world.training).toordinal()
    campus = build_campus(routes.seed, world.blocks, routes.streets)
    count = round(world.events_per_km_of_route * routes.route_m / 1000)
    campus, _ = pass_a_year(routes.seed, campus, routes.training.line_m, count, world.near_route)
    box = shapes_on(campus, day)[0]
    box = box[box["kind"] == Kind.BUILDING]
    east, north, up = points_m.T[..., None]
    ahead = (east - box["x_m"]) * box["cos_yaw"] + (north - box["y_m"]) * box["sin_yaw"]
    left = (north - box["y_m"]) * box["cos_yaw"] - (east - box["x_m"]) * box["sin_yaw"]
    beyond = np.stack([np.abs(ahead) - box["half_length_m"], np.abs(left) - box["half_width_m"], up - box["top_m"]])
    # Outside of a box over the positive axes, inside of it to the nearest face.
    outside_m = np.linalg.norm(beyond.clip(min=0), axis=0) - beyond.max(0).clip(max=0)
    return np.asarray(outside_m.min(1))
