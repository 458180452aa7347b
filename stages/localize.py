"""Stage `localize`: queries a model with the views of the test sequences.

For each query it writes a ranking of places with costs, and the query's novelty. For each sequence
it writes the threshold of novelty from which on a query is rejected as unseen; the threshold is
chosen on validation blocks of the training sequence.
"""

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.core import schemas, store
from pipeline.core.settings import Count, Names
from pipeline.matching.ranking import Rows
from pipeline.matching.stored_model import StoredModel, turned_deg
from stages import EachSequence, each_sequence, stage


@dataclass(frozen=True, kw_only=True)
class Settings(EachSequence):
    """The stage's settings: the keys of conf/localize.yaml."""

    method: Any
    model: Path
    views: Path
    perturbed: Path
    """Folder of the perturbed queries, drawn as the same view by the stage `perturbed`."""
    perturbations: Names = ()
    """The perturbations whose queries are answered too: files of conf/perturbation."""
    k: Count
    """Number of places ranked for each query."""
    rejection: Any
    """Chooses the thresholds of novelty on validation blocks."""


@stage("localize")
def main(settings: Settings) -> str:
    stored_model = StoredModel(str(settings.model), settings.method, settings.rejection, settings.k)

    def rank(sequence: str, folder: Path) -> str:
        """Write the rankings of one sequence: unperturbed, then in each perturbed case."""
        name = f"{sequence}.zarr"
        perturbed_paths = [
            settings.perturbed / perturbation / name for perturbation in settings.perturbations
        ]
        cases = Rows.queries(settings.views / name, perturbed_paths)
        return write_rankings(stored_model, cases, folder / name)

    return each_sequence(settings, rank, "localize", one_by_one_in_threads=True)


def write_rankings(stored_model: StoredModel, cases: dict[Any, Rows], path: Path) -> str:
    """Write the rankings of a sequence's queries in all cases; returns a one-line summary.

    `cases` holds the views of the queries in each case: unperturbed first, then perturbed.
    """
    ranking = stored_model.rank(cases)
    rejection = stored_model.rejection
    n_unperturbed = len(next(iter(cases.values())).stamps_ns)
    # one threshold for each kind of novelty
    thresholds = rejection.thresholds(stored_model.model, ranking.kinds)
    reject_from = tuple(float(threshold.reject_from) for threshold in thresholds)
    validation_precision = tuple(float(threshold.validation_precision) for threshold in thresholds)
    rankings = schemas.Rankings(
        **vars(ranking),
        turned_deg=turned_deg(cases).astype(np.float32),
        cases=[asdict(case) for case in cases],
        thresholds=reject_from,
        target_precision=rejection.target_precision,
        validation_precision=validation_precision,
    )
    store.write(path, rankings)
    # the summary is of the unperturbed queries, by the first kind of novelty, which is in use
    unperturbed_novelty = ranking.novelty[:n_unperturbed, 0].astype(float)
    n_rejected = int((unperturbed_novelty >= reject_from[0]).sum())
    n_places = ranking.places.shape[1]
    cases_note = f" in {len(cases)} cases" if len(cases) > 1 else ""
    summary = rejection.summary(stored_model.model, thresholds[0], n_rejected)
    return f"{path.stem}: {n_places} places for {n_unperturbed} queries{cases_note}, {summary}"


if __name__ == "__main__":
    main()
