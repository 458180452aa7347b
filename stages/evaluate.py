"""A ranking and the true places → counts, curves and outcomes by both protocols, and the few numbers that are compared."""

import json
from dataclasses import asdict

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
    evaluation, wanted = judged(cfg)
    numbers = summary(evaluation)
    rules = {name: asdict(instantiate(cfg[name])) for name in ("distance", "bootstrap")}
    attrs = {**evaluation.attrs(), **rules, "wanted_precision": wanted, "sequence": cfg.sequence, "train": cfg.train}
    with store.write(cfg.out, schemas.EVALUATIONS, **attrs) as out:
        for name, column in evaluation.columns().items():
            out.put(name, column)
    with store.replace(cfg.metrics) as metrics:
        metrics.write_text(json.dumps(numbers, indent=2, allow_nan=False) + "\n")
    return f"{cfg.sequence}: " + "; ".join(f"by {protocol} {told(numbers[protocol])}" for protocol in PROTOCOLS)


def told(numbers: dict[str, float | None]) -> str:
    """The few numbers of one protocol that a line has room for."""
    shown = {"recall@1": numbers["recall_at_1"], "oracle": numbers["oracle"], "AUC": numbers["auc_top1"]}
    return ", ".join(f"{name} {'none' if number is None else f'{number:.3f}'}" for name, number in shown.items())


def judged(cfg: DictConfig) -> tuple[Evaluation, float]:
    """The evaluation, and the precision that the ranking's thresholds were chosen for."""
    ranking, labels = store.read(cfg.ranking, schemas.RANKINGS), store.read(cfg.labels, schemas.LABELS)
    evaluation = judge(
        Ranking(**{name: ranking.load(name) for name in schemas.RANKINGS.columns}, kinds=tuple(ranking.attrs["kinds"])),
        ranking.attrs["thresholds"],
        Labels(**{name: labels.load(name) for name in schemas.LABELS.columns}),
        store.read(cfg.submaps, schemas.SUBMAPS).load("world_T_anchor"),
        int(labels.attrs["days"]),
        instantiate(cfg.distance),
        instantiate(cfg.bootstrap),
    )
    return evaluation, float(ranking.attrs["wanted_precision"])


if __name__ == "__main__":
    main()
