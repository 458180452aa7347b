"""How far off and how turned a first guess may be: `python -m benchmarks.basin
artifacts/map/campus/2012-01-15.zarr [basin.svg]`.

Each of some training submaps is registered with the nearest one at least 2 m away, from guesses
that are off by a step in a random direction and a turn to a random side. The share of
them that end within .5 m and 2° of the truth.
"""

import os

os.environ["OMP_NUM_THREADS"] = "1"  # before the libraries are loaded

import sys
from pathlib import Path

import numpy as np
from hydra.utils import instantiate
from matplotlib.figure import Figure
from numpy.typing import NDArray
from omegaconf import OmegaConf

from pipeline.core.frames import distance_and_turn, pose
from pipeline.posing.search import Fixer
from pipeline.posing.targets import Targets

STEPS_M = (0.0, 1.0, 2.0, 3.0, 4.0, 6.0, 8.0)
TURNS_DEG = (0.0, 5.0, 10.0, 15.0, 20.0, 30.0)
SUBMAPS = 12
LEAST_M = 2.0


def basin(targets: Targets, fixer: Fixer) -> NDArray[np.float64]:
    """The shares (step, turn)."""
    world_T_anchor = targets.world_T_anchor
    rng = np.random.default_rng(0)
    found = np.zeros((len(STEPS_M), len(TURNS_DEG)))
    for row in np.linspace(0, len(world_T_anchor) - 1, SUBMAPS).astype(int):
        away_m = np.linalg.norm(world_T_anchor[:, :3, 3] - world_T_anchor[row, :3, 3], axis=1)
        other = int(np.where(away_m < LEAST_M, np.inf, away_m).argmin())
        true = np.linalg.inv(world_T_anchor[other]) @ world_T_anchor[row]
        registration = fixer.registration
        source = registration.prepare(targets.points_m(row))
        target = targets.cloud(registration, other)
        for (i, step_m), (j, turn_deg) in (
            (a, b) for a in enumerate(STEPS_M) for b in enumerate(TURNS_DEG)
        ):
            bearing = rng.uniform(0, 2 * np.pi)
            side = rng.choice([-1, 1])
            step = np.array([[step_m * np.cos(bearing), step_m * np.sin(bearing), 0.0]])
            guess = true @ pose(step, np.array([[0.0, 0.0, side * np.deg2rad(turn_deg)]]))[0]
            approach = registration.approach(target, source, guess)
            ended = registration.refine(target, source, approach.target_T_source).target_T_source
            off_m, off_deg = distance_and_turn(ended[None], true[None])
            found[i, j] += (off_m[0] < 0.5) & (off_deg[0] < 2.0)
    return found / SUBMAPS


def draw(shares: NDArray[np.float64], path: Path) -> None:
    """A picture of the shares."""
    fig = Figure(figsize=(4.6, 3.4), layout="constrained")
    axis = fig.subplots()
    axis.imshow(shares, vmin=0, vmax=1, cmap="viridis", origin="lower", aspect="auto")
    for (i, j), share in np.ndenumerate(shares):
        axis.text(
            j,
            i,
            f"{share:.2f}",
            ha="center",
            va="center",
            color="black" if share > 0.5 else "white",
        )
    axis.set_xticks(range(len(TURNS_DEG)), [f"{turn:g}" for turn in TURNS_DEG])
    axis.set_yticks(range(len(STEPS_M)), [f"{step:g}" for step in STEPS_M])
    axis.set(
        xlabel="turn [°]", ylabel="step [m]", title="Registrations that end within .5 m and 2°"
    )
    fig.savefig(path)


def main(path: str, picture: str = "") -> None:
    """Print the shares, and draw them where a path is given."""
    shares = basin(Targets.read(Path(path)), instantiate(OmegaConf.load("conf/poses.yaml").fixer))
    print("step \\ turn " + "".join(f"{turn:6g}°" for turn in TURNS_DEG))
    for step_m, row in zip(STEPS_M, shares, strict=True):
        print(f"{step_m:9g} m " + "".join(f"{share:7.2f}" for share in row))
    if picture:
        draw(shares, Path(picture))


if __name__ == "__main__":
    main(*sys.argv[1:])
