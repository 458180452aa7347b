"""A ranking and the true places → counts, curves and per-query outcomes, and the few numbers that are compared."""

import json
from dataclasses import asdict

from omegaconf import DictConfig

from pipeline import schemas, store
from pipeline.evaluation.judgement import judge, summary
from stages import stage


@stage("evaluate")
def main(cfg: DictConfig) -> str:
    ranking, labels = store.read(cfg.ranking, schemas.RANKINGS), store.read(cfg.labels, schemas.LABELS)
    threshold, days = float(ranking.attrs["threshold"]), int(labels.attrs["days"])
    judgement = judge(
        ranking.load("places"),
        ranking.load("xy_m"),
        ranking.load("novelty"),
        labels.load("places"),
        store.read(cfg.submaps, schemas.SUBMAPS).load("world_T_anchor"),
        labels.load("oracle"),
        labels.load("nearest_turn_deg"),
        threshold,
    )
    numbers = summary(judgement, threshold, days)
    with store.write(cfg.out, schemas.EVALUATIONS, days=days, threshold=threshold, sequence=cfg.sequence, train=cfg.train) as out:
        for name, column in asdict(judgement).items():
            out.put(name, column)
    with store.replace(cfg.metrics) as metrics:
        metrics.write_text(json.dumps(numbers, indent=2) + "\n")
    shown = ", ".join(f"{name} {numbers[name]:.3f}" for name in ("top1", "oracle_top1", "auc_top1") if numbers[name] is not None)
    return f"{cfg.sequence}: {numbers['seen']} seen, {numbers['unseen']} unseen, {shown}"


if __name__ == "__main__":
    main()
