"""All that was measured of one study → its table of results, and the plain data of two plots for
`dvc plots`."""

from pathlib import Path

from hydra.utils import instantiate
from omegaconf import DictConfig

from pipeline import store
from pipeline.evaluation import results
from pipeline.evaluation.plots import precision_recall, year
from pipeline.studies.known import studies
from pipeline.studies.layout import Layout
from stages import ROOT, stage


@stage("results")
def main(cfg: DictConfig) -> str:
    study = studies(ROOT / "conf")[cfg.study]
    rules = {
        "ageing": instantiate(cfg.ageing),
        "bands": instantiate(cfg.bands),
        "unseen_share": cfg.unseen_share,
    }
    gathering = results.Gathering(Layout(Path(cfg.artifacts)), study, **rules)
    table = gathering.table()
    with store.replace(cfg.out) as folder:
        folder.mkdir()
        table.to_csv(folder / results.FILE, index=False)
        year(table).to_csv(folder / "year.csv", index=False, float_format="%.6g")
        precision_recall(gathering).to_csv(
            folder / "precision_recall.csv", index=False, float_format="%.6g"
        )
    models = table.loc[table["method"] != "", ["method", "variant", "seed"]].drop_duplicates()
    return (
        f"{len(table):,} numbers of {len(models)} models on "
        f"{table['sequence'].replace('', None).nunique()} sequences"
    )


if __name__ == "__main__":
    main()
