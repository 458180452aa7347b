"""A model and the test sequences' views → a ranking of places for each query, and when to reject
one as unseen."""

from dataclasses import asdict
from math import isnan
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.matching.asking import Asked, turned_deg
from pipeline.matching.ranking import Rows
from stages import ProgressBar, stage


@stage("localize")
def main(cfg: DictConfig) -> str:
    sequences = cfg.sequences.split()
    asked = Asked(cfg.model, instantiate(cfg.method), instantiate(cfg.rejection), cfg.k)
    with instantiate(cfg.compute).apart() as compute, store.replace(cfg.out) as folder:
        folder.mkdir()
        lines = compute.each(lambda sequence: rank(cfg, sequence, asked, folder), sequences)
        return "; ".join(ProgressBar().track(lines, len(sequences), "localize"))


def rank(cfg: DictConfig, sequence: str, asked: Asked, folder: Path) -> str:
    """The rankings of one sequence: as driven, then of each altered case."""
    name = f"{sequence}.zarr"
    alterations = (cfg.alterations or "").split()
    cases = Rows.queries(
        Path(cfg.views, name), [Path(cfg.altered, alteration, name) for alteration in alterations]
    )
    ranking = asked.rank(cases)
    rejection = asked.rejection
    driven = len(next(iter(cases.values())).stamps_ns)
    thresholds = rejection.thresholds(asked.model, ranking.kinds)
    reject_from, kept = ([float(one) for one in values] for values in zip(*thresholds, strict=True))
    chosen = {
        "thresholds": reject_from,
        "kept_precision": [None if isnan(one) else one for one in kept],
    }
    attrs = {
        "cases": [asdict(case) for case in cases],
        "wanted_precision": rejection.wanted_precision,
        **chosen,
    }
    with store.write(folder / name, schemas.RANKINGS, kinds=ranking.kinds, **attrs) as out:
        out.put("turned_deg", turned_deg(cases))
        for column in schemas.RANKINGS.columns.keys() - {"turned_deg"}:
            out.put(column, getattr(ranking, column))
    rejected = int((ranking.novelty[:driven, 0].astype(float) >= reject_from[0]).sum())
    altered = f" in {len(cases)} cases" if len(cases) > 1 else ""
    said = rejection.summary(asked.model, thresholds[0], rejected)
    return f"{sequence}: {ranking.places.shape[1]} places for {driven} queries{altered}, {said}"


if __name__ == "__main__":
    main()
