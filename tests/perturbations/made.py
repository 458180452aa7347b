"""Perturbs one cloud of points, for the tests of all perturbations."""

import numpy as np

from pipeline.perturbations import Perturbation


def perturbed(
    perturbation: Perturbation, points_m: np.ndarray, stamp_ns: int = 3
) -> list[tuple[np.ndarray, float]]:
    """For each case the perturbed points and the turn in radians, of the query with this stamp."""
    rngs = [np.random.default_rng((perturbation.seed, stamp_ns)) for _ in perturbation.cases]
    return [
        perturbation.perturb(case, points_m, rng)
        for case, rng in zip(perturbation.cases, rngs, strict=True)
    ]
