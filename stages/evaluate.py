"""A ranking and the true places → counts, curves and outcomes by both protocols, and the few numbers that are compared."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.evaluation.judgement import Evaluation, judge, summary
from pipeline.evaluation.protocols import PROTOCOLS
from pipeline.matching.places import Labels
from pipeline.matching.ranking import Ranking
from stages import stage


@stage("evaluate")
def main(cfg: DictConfig) -> str:
    numbers: dict[str, Any] = {}
    sequences = cfg.sequences.split()
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        for done in instantiate(cfg.compute).each(lambda sequence: judged(cfg, sequence, folder), sequences):
            numbers |= done
    with store.replace(cfg.metrics) as metrics:
        metrics.write_text(json.dumps(numbers, indent=2, allow_nan=False) + "\n")
    return "; ".join(f"{name}: " + ", ".join(f"by {by} {told(own[by])}" for by in PROTOCOLS) for name, own in numbers.items())


def judged(cfg: DictConfig, sequence: str, folder: Path) -> dict[str, dict[str, Any]]:
    """One sequence's evaluation, and the few numbers of it by its name."""
    evaluation, wanted = judgement(cfg, sequence)
    rules = {name: asdict(instantiate(cfg[name])) for name in ("distance", "bootstrap")}
    attrs = {**evaluation.attrs(), **rules, "wanted_precision": wanted, "sequence": sequence, "train": cfg.train}
    with store.write(folder / f"{sequence}.zarr", schemas.EVALUATIONS, **attrs) as out:
        for name, column in evaluation.columns().items():
            out.put(name, column)
    return {sequence: summary(evaluation)}


def judgement(cfg: DictConfig, sequence: str) -> tuple[Evaluation, float]:
    """The evaluation, and the precision that the ranking's thresholds were chosen for."""
    name = f"{sequence}.zarr"
    ranking, labels = (
        store.read(Path(cfg.rankings, name), schemas.RANKINGS),
        store.read(Path(cfg.labels, name), schemas.LABELS),
    )
    evaluation = judge(
        Ranking(**{name: ranking.load(name) for name in schemas.RANKINGS.columns}, kinds=tuple(ranking.attrs["kinds"])),
        ranking.attrs["thresholds"],
        Labels(**{name: labels.load(name) for name in schemas.LABELS.columns}),
        store.read(Path(cfg.submaps, name), schemas.SUBMAPS).load("world_T_anchor"),
        int(labels.attrs["days"]),
        instantiate(cfg.distance),
        instantiate(cfg.bootstrap),
    )
    return evaluation, float(ranking.attrs["wanted_precision"])


def told(numbers: dict[str, float | None]) -> str:
    """The few numbers of one protocol that a line has room for."""
    shown = {"recall@1": numbers["recall_at_1"], "AUC": numbers["auc_top1"]}
    return ", ".join(f"{name} {'none' if number is None else f'{number:.3f}'}" for name, number in shown.items())


if __name__ == "__main__":
    main()
