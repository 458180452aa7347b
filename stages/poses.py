"""Rankings and the map → a pose of each query, its places re-ranked, and whether to believe it."""

from dataclasses import replace
from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.matching.places import Places
from pipeline.matching.ranking import Rows
from pipeline.posing.answers import Posing
from pipeline.posing.fix import Fix
from pipeline.posing.held_out import Drive, TrainingDay
from pipeline.posing.queries import Queries
from pipeline.posing.search import Fixer
from pipeline.posing.verdict import Verdict
from stages import ProgressBar, build, stage


@stage("poses")
def main(cfg: DictConfig) -> str:
    labels = store.read(Path(cfg.labels, f"{cfg.train}.zarr"), schemas.Labels)
    sequences = cfg.sequences.split()
    fixer = instantiate(cfg.fixer, **cfg.budget.get("poses", {}))
    map_path = Path(cfg.map, f"{cfg.train}.zarr")
    day = TrainingDay(
        map_path,
        Drive(Path(cfg.scans, map_path.name), Path(cfg.submaps, map_path.name)),
        Rows.read(Path(cfg.views, map_path.name)),
        labels.places,
        instantiate(cfg.view),
        instantiate(cfg.method).localizer(store.read_model(cfg.model)),
        cfg.k,
    )
    with instantiate(cfg.compute) as compute, store.replace(cfg.out) as folder:
        folder.mkdir()
        evidence = instantiate(cfg.held_out).evidence(fixer, day, compute, ProgressBar())
        verdict = Verdict(evidence, cfg.unseen_share)
        posing = Posing(verdict, Places.of(labels), cfg.wanted_precision)
        fixer = replace(fixer, chances=verdict.judge.pose)
        lines = [f"{len(evidence.fixes)} fixes of {evidence.blocks} held-out blocks"]
        fixes_by_sequence = compute.each(
            lambda sequence: fixes(cfg, fixer, map_path, sequence), sequences
        )
        for sequence, sequence_fixes in zip(
            sequences,
            ProgressBar().track(fixes_by_sequence, len(sequences), "register"),
            strict=True,
        ):
            rankings = store.read(Path(cfg.rankings, f"{sequence}.zarr"), schemas.Rankings)
            lines.append(posing.write(folder / f"{sequence}.zarr", rankings, sequence_fixes))
    return "; ".join(lines)


def fixes(cfg: DictConfig, fixer: Fixer, map_path: Path, sequence: str) -> list[Fix]:
    """The fixes of one sequence; it may run in a process of its own."""
    alterations = [build("alteration", name) for name in (cfg.alterations or "").split()]
    rankings = (cfg.rankings, *cfg.others.split())
    return Queries(sequence, cfg.scans, cfg.submaps, rankings, alterations).fixes(
        fixer, map_path, cfg.k
    )


if __name__ == "__main__":
    main()
