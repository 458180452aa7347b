"""A model and the test sequences' views → a ranking of places for each query, and when to reject
one as unseen."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.matching.asking import StoredModel, turned_deg
from pipeline.matching.ranking import Rows
from stages import ProgressBar, stage


@stage("localize")
def main(cfg: DictConfig) -> str:
    sequences = cfg.sequences.split()
    stored_model = StoredModel(
        cfg.model, instantiate(cfg.method), instantiate(cfg.rejection), cfg.k
    )
    with instantiate(cfg.compute).apart() as compute, store.replace(cfg.out) as folder:
        folder.mkdir()
        lines = compute.each(lambda sequence: rank(cfg, sequence, stored_model, folder), sequences)
        return "; ".join(ProgressBar().track(lines, len(sequences), "localize"))


def rank(cfg: DictConfig, sequence: str, stored_model: StoredModel, folder: Path) -> str:
    """The rankings of one sequence: as driven, then of each altered case."""
    name = f"{sequence}.zarr"
    alterations = (cfg.alterations or "").split()
    cases = Rows.queries(
        Path(cfg.views, name), [Path(cfg.altered, alteration, name) for alteration in alterations]
    )
    ranking = stored_model.rank(cases)
    rejection = stored_model.rejection
    n_driven = len(next(iter(cases.values())).stamps_ns)
    thresholds = rejection.thresholds(stored_model.model, ranking.kinds)
    reject_from, kept_precision = (
        tuple(map(float, values)) for values in zip(*thresholds, strict=True)
    )
    rankings = schemas.Rankings(
        **vars(ranking),
        turned_deg=turned_deg(cases).astype(np.float32),
        cases=[asdict(case) for case in cases],
        thresholds=reject_from,
        wanted_precision=rejection.wanted_precision,
        kept_precision=kept_precision,
    )
    store.write(folder / name, rankings)
    rejected = int((ranking.novelty[:n_driven, 0].astype(float) >= reject_from[0]).sum())
    altered = f" in {len(cases)} cases" if len(cases) > 1 else ""
    summary = rejection.summary(stored_model.model, thresholds[0], rejected)
    return (
        f"{sequence}: {ranking.places.shape[1]} places for {n_driven} queries{altered}, {summary}"
    )


if __name__ == "__main__":
    main()
