"""Rankings and the map → a pose of each query, its places re-ranked, and whether to believe it."""

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.matching.ranking import Rows
from pipeline.posing.answers import Posing
from pipeline.posing.fix import Fix
from pipeline.posing.queries import Queries
from pipeline.posing.targets import Targets
from pipeline.posing.verdict import Verdict
from stages import ProgressBar, stage


@stage("poses")
def main(cfg: DictConfig) -> str:
    labels, sequences = store.read(Path(cfg.labels, f"{cfg.train}.zarr"), schemas.LABELS), cfg.sequences.split()
    posing = Posing(verdict(cfg, labels.load("places")), labels, cfg.fixer.apart_m, cfg.novelty, cfg.wanted_precision)
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        found = instantiate(cfg.compute).each(lambda sequence: fixes(cfg, sequence), sequences)
        for sequence, own in zip(sequences, ProgressBar().track(found, len(sequences), "register"), strict=True):
            posing.write(folder / f"{sequence}.zarr", store.read(Path(cfg.rankings, f"{sequence}.zarr"), schemas.RANKINGS), own)
    return "; ".join(posing.lines)


def verdict(cfg: DictConfig, places: object) -> Verdict:
    """What fixes on held-out blocks of the training day are worth."""
    targets, views = Targets(Path(cfg.map, f"{cfg.train}.zarr")), Rows.read(Path(cfg.views, f"{cfg.train}.zarr"))
    localizer = instantiate(cfg.method).localizer(store.read_model(cfg.model))
    asked = (instantiate(cfg.fixer), targets, localizer, views, places, cfg.k, ProgressBar())
    return Verdict(instantiate(cfg.held_out).evidence(*asked), cfg.unseen_share)


def fixes(cfg: DictConfig, sequence: str) -> list[Fix]:
    """The fixes of one sequence; it may run in a process of its own."""
    queries = Queries(sequence, cfg.scans, cfg.submaps, (cfg.rankings, *cfg.others.split()))
    return queries.fixes(instantiate(cfg.fixer), Path(cfg.map, f"{cfg.train}.zarr"), cfg.k)


if __name__ == "__main__":
    main()
